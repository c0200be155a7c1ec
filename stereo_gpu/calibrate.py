"""From pictures of a checkerboard to a rig: each camera by itself, then both together."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from stereo_gpu.calibration.board import Board, BoardView, in_both
from stereo_gpu.calibration.board_pairs import FEWEST_PAIRS, BoardPair, Progress, Source, find_pairs
from stereo_gpu.calibration.pairing import LensView, pair_corners
from stereo_gpu.errors import CalibrationError, InputError
from stereo_gpu.rig import DISTORTION_COUNTS, Camera, Rig, ViewError
from stereo_gpu.types import Doubles, Floats

OUTLIER_FACTOR = 3.0  # a view that fits this many times worse than the median one is left out
OUTLIER_FLOOR_PX = 0.3  # but none that fits better than this
CARRIED_FACTOR = 10.0  # a board carried over with another view's R and T fits worse than it will after all views
CARRIED_LIMIT = 0.02  # of the picture's width: worse than that, the pairs do not belong together
SHORTEST_BASELINE = 1e-3  # of the distance to the boards
LENS_FLAGS = {5: 0, 8: cv2.CALIB_RATIONAL_MODEL, 12: cv2.CALIB_RATIONAL_MODEL | cv2.CALIB_THIN_PRISM_MODEL}
STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 200, 1e-9)

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Lens:
    """One camera calibrated by itself."""

    matrix: Doubles
    distortion: Doubles
    views: list[LensView]
    errors_px: Doubles


def calibrate(
    left: Sequence[Source],
    right: Sequence[Source],
    board: Board,
    *,
    coefficients: int = 5,
    progress: Progress | None = None,
) -> Rig:
    """Calibrate two cameras from pictures of a board.

    Each camera is calibrated by itself (Zhang 2000), then both together with all parameters free. Pairs that
    fit far worse than the typical one are left out, with the reason in `rig.views`.

    Args:
        left, right: files or pictures, the pairs in one order; every picture of one camera of one size.
        board: what they show.
        coefficients: 5, 8 or 12 numbers for the lens distortion.
        progress: told how many of the pictures have been searched, and how many there are.

    Raises:
        InputError: the lists or `coefficients` are wrong.
        PictureError: a picture cannot be read, or a camera's pictures differ in size.
        CalibrationError: the pictures do not show such a board often enough, or give no sensible rig.
    """
    if coefficients not in DISTORTION_COUNTS:
        raise InputError(f"coefficients is {coefficients!r:.60}: give 5, 8 or 12")
    pairs, sizes = find_pairs(left, right, board, progress)
    lenses: list[_Lens] = []
    while not lenses or any(len(lens.views) != len(_used(pairs)) for lens in lenses):
        # Again where one camera lost a pair that the other one still holds.
        lenses = [_calibrate_lens(pairs, side, sizes[side], board, coefficients) for side in (0, 1)]
    distance = float(np.median([view.translation[2] for view in lenses[0].views]))
    start = _agree(pairs, lenses, sizes[1][0], board)
    rig = _calibrate_together(pairs, lenses, start, sizes, board, coefficients)
    _refuse_nonsense(rig, distance)
    logger.info(
        "calibrated: %d of %d pairs, %.3f px, baseline %.4g %s",
        sum(view.used for view in rig.views),
        len(rig.views),
        rig.rms_px,
        rig.baseline,
        rig.unit,
    )
    return rig


def _outliers(errors: Doubles, factor: float = OUTLIER_FACTOR, floor: float = OUTLIER_FLOOR_PX) -> list[int]:
    """Numbers of the views that fit badly; only the worst at a time, since one bad view spoils the others."""
    limit = max(floor, factor * float(np.median(errors)), float(errors.max()) / 2)
    return np.flatnonzero(errors > limit).tolist()


def _used(pairs: list[BoardPair]) -> list[BoardPair]:
    """The pairs that are still in."""
    used = [pair for pair in pairs if not pair.reason]
    if len(used) < FEWEST_PAIRS:
        reasons = Counter(pair.reason.split(":")[0] for pair in pairs if pair.reason)
        told = "; ".join(f"{count} x {reason}" for reason, count in reasons.most_common(3))
        raise CalibrationError(
            f"{len(used)} of {len(pairs)} pairs fit together, {FEWEST_PAIRS} are needed ({told}):"
            " hold the board still and take more"
        )
    return used


def _drop(used: list[BoardPair], errors: Doubles, numbers: list[int], what: str) -> None:
    for number in numbers:
        used[number].drop(f"{what}: {errors[number]:.2f} px, typical {float(np.median(errors)):.2f} px")


def _views(pairs: list[BoardPair], side: int) -> list[BoardView]:
    return [view for pair in pairs if (view := pair.views[side]) is not None]


def _calibrate_lens(pairs: list[BoardPair], side: int, size: tuple[int, int], board: Board, coefficients: int) -> _Lens:
    """Calibrate one camera by itself, leaving out the views that do not fit."""
    while True:
        used = _used(pairs)
        seen = _views(used, side)
        try:
            _, matrix, distortion, turns, shifts, _, _, view_errors = cv2.calibrateCameraExtended(
                [board.points[view.ids] for view in seen],
                [view.corners for view in seen],
                size,
                None,
                None,
                flags=LENS_FLAGS[coefficients],
                criteria=STOP,
            )
        except cv2.error as error:
            raise CalibrationError(f"{_side(side)} camera: {_degenerate(error)}") from error
        errors = np.asarray(view_errors, np.float64).reshape(-1)
        if not (np.isfinite(matrix).all() and np.isfinite(errors).all()):
            raise CalibrationError(f"{_side(side)} camera: {_degenerate(None)}")
        bad = _outliers(errors)
        if not bad:
            views = [
                LensView(seen=view, rotation=cv2.Rodrigues(turn)[0], translation=shift.reshape(3))
                for view, turn, shift in zip(seen, turns, shifts, strict=True)
            ]
            return _Lens(matrix, distortion.reshape(-1)[:coefficients].copy(), views, errors)
        _drop(used, errors, bad, f"does not fit the {_side(side)} camera")


def _agree(pairs: list[BoardPair], lenses: list[_Lens], width: int, board: Board) -> tuple[Doubles, Doubles]:
    """Settle which end of the board is which, leave out pairs that do not belong together; first R and T."""
    used = _used(pairs)
    left, right = lenses
    agreement = pair_corners(left.views, right.views, board, right.matrix, right.distortion)
    errors = agreement.errors_px
    if not np.median(errors) <= CARRIED_LIMIT * width:
        raise CalibrationError(
            f"the pairs do not agree on one rig (typically {np.median(errors):.0f} px off): give left and right"
            " pictures in the same order, and leave the cameras where they are between pairs"
        )
    for pair, view in zip(used, agreement.right, strict=True):
        pair.views[1] = view
    limit = max(CARRIED_FACTOR * float(np.median(errors)), CARRIED_LIMIT / 4 * width)
    bad = np.flatnonzero(errors > limit).tolist()
    _drop(used, errors, bad, "left and right do not belong together, or the cameras or the board moved")
    return agreement.R, agreement.T


def _calibrate_together(
    pairs: list[BoardPair],
    lenses: list[_Lens],
    start: tuple[Doubles, Doubles],
    sizes: list[tuple[int, int]],
    board: Board,
    coefficients: int,
) -> Rig:
    """Refine everything at once, leaving out the pairs that do not fit.

    Keeping the cameras' own parameters fixed instead gave the same error but, on the boards of J.-Y. Bouguet,
    a rotation twice as far from the published one.
    """
    flags = LENS_FLAGS[coefficients] | cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_USE_EXTRINSIC_GUESS
    left, right = lenses
    while True:
        used = _used(pairs)
        seen = [in_both(*views) for views in zip(_views(used, 0), _views(used, 1), strict=True)]
        corners = [ours.corners for ours, _ in seen], [theirs.corners for _, theirs in seen]
        try:
            rms, *found, rotation, translation, _, _, _, _, view_errors = cv2.stereoCalibrateExtended(
                [board.points[ours.ids] for ours, _ in seen],
                *corners,
                left.matrix.copy(),
                left.distortion.copy(),
                right.matrix.copy(),
                right.distortion.copy(),
                sizes[0],
                start[0].copy(),
                start[1].reshape(3, 1).copy(),
                flags=flags,
                criteria=STOP,
            )
        except cv2.error as error:
            raise CalibrationError(_degenerate(error)) from error
        errors = np.asarray(view_errors, np.float64)
        if not (np.isfinite(rms) and np.isfinite(errors).all()):
            raise CalibrationError(_degenerate(None))
        bad = _outliers(errors.max(axis=1))
        if not bad:
            break
        _drop(used, errors.max(axis=1), bad, "left and right do not fit together")
    cameras = [
        Camera(
            found[2 * side],
            found[2 * side + 1].reshape(-1)[:coefficients],
            sizes[side],
            float(np.sqrt((errors[:, side] ** 2).mean())),
        )
        for side in (0, 1)
    ]
    epipolar = epipolar_errors(*corners, cameras[0], cameras[1], rotation, translation.reshape(3))
    fits = iter(np.column_stack([errors, epipolar]).tolist())
    return Rig(
        left=cameras[0],
        right=cameras[1],
        R=rotation,
        T=translation.reshape(3),
        rms_px=float(rms),
        epipolar_rms_px=float(np.sqrt((epipolar**2).mean())),
        views=tuple(
            ViewError(*pair.names, used=False, reason=pair.reason)
            if pair.reason
            else ViewError(*pair.names, *next(fits))
            for pair in pairs
        ),
        unit=board.unit,
    )


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


def _refuse_nonsense(rig: Rig, distance: float) -> None:
    """Make sure that the cameras stand apart, and in order."""
    shift = ", ".join(f"{value:.4g}" for value in rig.T)
    if rig.baseline < SHORTEST_BASELINE * distance:
        raise CalibrationError(
            f"T = ({shift}) {rig.unit}: the cameras stand at one point; are left and right the same pictures?"
        )
    right_camera = -rig.R.T @ rig.T  # where it stands in the left camera's frame
    if -right_camera[0] == np.abs(right_camera).max():
        raise CalibrationError(
            f"T = ({shift}) {rig.unit}, but T[0] must be below zero, as X_right = R X_left + T: left and right look"
            " swapped, give them the other way round"
        )


def _side(side: int) -> str:
    return ("left", "right")[side]


def _degenerate(error: cv2.error | None) -> str:
    detail = f" ({' '.join(error.err.split())[:80]})" if error is not None else ""
    return f"the boards give no calibration{detail}: tilt the board in more directions, fill more of the picture"
