"""A fit as people and files want it: the rig with the errors of every pair, and what became of the pairs."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from stereo_gpu.boards.board import Board, BoardView, in_both
from stereo_gpu.calibration.bundle import PINHOLE, lens_matrix, project
from stereo_gpu.calibration.fit import Fit, view_distances
from stereo_gpu.calibration.lenses import seen_by
from stereo_gpu.calibration.outcome import CalibrationView
from stereo_gpu.deviations import Deviations
from stereo_gpu.rig import Camera, Rig, ViewError
from stereo_gpu.types import Doubles, Floats

FEWEST_FOR_POSE = 6  # corners


def make_rig(fit: Fit, sizes: Sequence[tuple[int, int]], board: Board, deviations: Deviations) -> Rig:
    """The rig of a fit."""
    bundle = fit.bundle
    sides = view_distances(bundle, fit.corners)
    left, right = (
        Camera(lens_matrix(lens), lens[PINHOLE:], size, _rms(np.concatenate(distances)))
        for lens, size, distances in zip(bundle.lenses, sizes, sides, strict=True)
    )
    common = [in_both(*views) for views in zip(*(seen_by(fit.used, side) for side in (0, 1)), strict=True)]
    epipolar = epipolar_errors(
        [ours.corners for ours, _ in common], [theirs.corners for _, theirs in common], left, right, bundle.R, bundle.T
    )
    errors = iter(zip(map(_rms, sides[0]), map(_rms, sides[1]), epipolar.tolist(), strict=True))
    return Rig(
        left=left,
        right=right,
        R=bundle.R,
        T=bundle.T,
        rms_px=_rms(np.concatenate([*sides[0], *sides[1]])),
        epipolar_rms_px=_rms(epipolar),
        views=tuple(
            ViewError(*pair.names, used=False, reason=pair.reason)
            if pair.reason
            else ViewError(*pair.names, *next(errors))
            for pair in fit.pairs
        ),
        unit=board.unit,
        deviations=deviations,
    )


def describe_views(fit: Fit, board: Board) -> tuple[CalibrationView, ...]:
    """What became of every pair.

    A pair that is left out has no part in the fit: there each picture's corners are put where the camera sees them
    with a board pose of their own, the left one's being that of the view.
    """
    bundle = fit.bundle
    modelled = [project(bundle, ours, side)[0] for side, ours in enumerate(fit.corners)]
    described, number = [], 0
    for pair in fit.pairs:
        rotation: Doubles | None
        translation: Doubles | None
        if pair.reason:
            left, right = (_alone(view, bundle.lenses[side], board) for side, view in enumerate(pair.views))
            projected = left[0], right[0]
            rotation, translation = left[1:]
        else:
            on_left, on_right = (
                places[ours.view == number].astype(np.float32)
                for places, ours in zip(modelled, fit.corners, strict=True)
            )
            projected = on_left, on_right
            rotation, translation = bundle.rotations[number], bundle.translations[number]
            number += 1
        seen_left, seen_right = (None if view is None else view.corners for view in pair.views)
        left_ids, right_ids = (None if view is None else view.ids for view in pair.views)
        described.append(
            CalibrationView(
                left=pair.names[0],
                right=pair.names[1],
                used=not pair.reason,
                reason=pair.reason,
                seen=(seen_left, seen_right),
                projected=projected,
                rotation=rotation,
                translation=translation,
                ids=(left_ids, right_ids),
            )
        )
    return tuple(described)


def epipolar_errors(
    left_corners: Sequence[Floats],
    right_corners: Sequence[Floats],
    left: Camera,
    right: Camera,
    rotation: Doubles,
    translation: Doubles,
) -> Doubles:
    """(views,) rms distance in px between undistorted points and the epipolar lines of their partners.

    Args:
        left_corners, right_corners: (N, 2) px of each view, as the cameras saw them.
        left, right: the cameras.
        rotation, translation: X_right = R X_left + T.
    """
    x, y, z = translation
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ rotation
    fundamental = np.linalg.inv(right.matrix).T @ essential @ np.linalg.inv(left.matrix)
    errors = []
    for corners in zip(left_corners, right_corners, strict=True):
        flat = [
            cv2.undistortPoints(
                seen.reshape(-1, 1, 2).astype(np.float64), camera.matrix, camera.distortion, P=camera.matrix
            )
            for seen, camera in zip(corners, (left, right), strict=True)
        ]
        ends = [cv2.convertPointsToHomogeneous(points).reshape(-1, 3) for points in flat]
        lines = ends[0] @ fundamental.T, ends[1] @ fundamental
        algebraic = (ends[1] * lines[0]).sum(axis=1)
        squares = [(algebraic / np.linalg.norm(line[:, :2], axis=1)) ** 2 for line in lines]
        errors.append(np.sqrt(np.mean(squares)))
    return np.array(errors)


def _alone(view: BoardView | None, lens: Doubles, board: Board) -> tuple[Floats | None, Doubles | None, Doubles | None]:
    """Where one camera's model puts a view's corners with the pose that fits them best, and that pose."""
    if view is None or len(view.ids) < FEWEST_FOR_POSE:
        return None, None, None
    points = board.points[view.ids].astype(np.float64)
    camera = lens_matrix(lens), lens[PINHOLE:]
    solved, turn, shift = cv2.solvePnP(points, view.corners.astype(np.float64), *camera)
    if not (solved and np.isfinite(turn).all() and np.isfinite(shift).all()):
        return None, None, None
    places = cv2.projectPoints(points, turn, shift, *camera)[0].reshape(-1, 2)
    return places.astype(np.float32), cv2.Rodrigues(turn)[0], shift.reshape(3)


def _rms(values: Doubles) -> float:
    return float(np.sqrt((values**2).mean()))
