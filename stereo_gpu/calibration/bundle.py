"""Both cameras and every board pose, fitted at once to all corners: bundle adjustment with the poses reduced out.

The model is OpenCV's, and so are its derivatives (`cv2.projectPoints`). What is left is sparse: a view's corners
depend on its own pose and on what all views share, so that the poses leave the normal equations by the Schur
complement (Triggs, McLauchlan, Hartley and Fitzgibbon, "Bundle Adjustment - A Modern Synthesis", 1999, section 6).
Unlike `cv2.stereoCalibrate` this keeps corners that only one of the cameras sees, starts where it is told, and
leaves the information about every parameter behind, of which deviations and advice are made.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import cv2
import numpy as np

from stereo_gpu.boards.board import Board, BoardView
from stereo_gpu.errors import CalibrationError
from stereo_gpu.types import Doubles, Ints

POSE = 6  # numbers of a pose: rotation, translation
PINHOLE = 4  # of a camera besides its distortion: fx fy cx cy
MOST_STEPS = 100
SETTLED = 1e-10  # of the sum of squares: a step that gains less is the last one
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-4, 1e-12, 1e8


@dataclass(frozen=True, eq=False)
class Bundle:
    """All unknowns of a calibration.

    Args:
        lenses: of the left and the right camera, (4 + n,): fx fy cx cy in px, then the distortion.
        R, T: (3, 3) and (3,): X_right = R X_left + T.
        rotations, translations: (views, 3, 3) and (views, 3), board to left camera frame.
    """

    lenses: tuple[Doubles, Doubles]
    R: Doubles
    T: Doubles
    rotations: Doubles
    translations: Doubles

    @property
    def shared(self) -> int:
        """How many numbers all views share: left lens, right lens, rotation and translation between the cameras."""
        return len(self.lenses[0]) + len(self.lenses[1]) + POSE

    def only(self, views: Sequence[int]) -> Bundle:
        """With the poses of these views alone."""
        chosen = list(views)
        return replace(self, rotations=self.rotations[chosen], translations=self.translations[chosen])


@dataclass(frozen=True, eq=False)
class Corners:
    """One camera's corners over all views, one view after another.

    Args:
        view: (m,) which view each belongs to, rising.
        points: (m, 3) on the board.
        seen: (m, 2) px.
    """

    view: Ints
    points: Doubles
    seen: Doubles

    def only(self, views: Sequence[int]) -> Corners:
        """Those of these views alone, given in rising order, which are numbered anew."""
        kept = np.isin(self.view, views)
        return Corners(np.searchsorted(views, self.view[kept]).astype(np.int32), self.points[kept], self.seen[kept])

    @classmethod
    def of(cls, views: Sequence[BoardView], board: Board) -> Corners:
        """Of the views of one camera."""
        points = board.points.astype(np.float64)
        return cls(
            np.repeat(np.arange(len(views), dtype=np.int32), [len(view.ids) for view in views]),
            np.concatenate([points[view.ids] for view in views]),
            np.concatenate([view.corners for view in views]).astype(np.float64),
        )


@dataclass(eq=False)
class Normal:
    """The normal equations of a bundle, view by view; information is per px² of variance.

    Args:
        shared, gradient: (views, P, P) and (views, P), of what all views share.
        cross: (views, P, 6), between that and the view's pose.
        pose, pose_gradient: (views, 6, 6) and (views, 6).
        squares: sum of squared residuals, px².
    """

    shared: Doubles
    gradient: Doubles
    cross: Doubles
    pose: Doubles
    pose_gradient: Doubles
    squares: float

    def reduced(self) -> tuple[Doubles, Doubles]:
        """(views, P, P) and (views, P): what each view says of the shared numbers once its pose is free."""
        solved = _solve(self.pose, np.swapaxes(self.cross, 1, 2))  # (views, 6, P)
        information: Doubles = self.shared - self.cross @ solved
        gradient: Doubles = self.gradient - np.einsum("vip,vi->vp", solved, self.pose_gradient)
        return information, gradient


def lens_matrix(lens: Doubles) -> Doubles:
    """(3, 3) camera matrix of (4 + n,) numbers."""
    fx, fy, cx, cy = lens[:PINHOLE]
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def residuals(bundle: Bundle, corners: tuple[Corners, Corners]) -> tuple[Doubles, Doubles]:
    """(m, 2) px for each camera: where the model puts each corner, less where it was seen."""
    return tuple(  # type: ignore[return-value]
        project(bundle, ours, side)[0] - ours.seen for side, ours in enumerate(corners)
    )


def project(bundle: Bundle, corners: Corners, side: int) -> tuple[Doubles, Doubles, Doubles, Doubles]:
    """Where the model puts a camera's corners.

    Returns:
        (m, 2) px; its derivatives (m, 2, 4 + n) by the lens and (m, 2, 3) by the place in the camera's frame; and
        (m, 3) that place.
    """
    turned = np.einsum("mij,mj->mi", bundle.rotations[corners.view], corners.points)
    places = turned + bundle.translations[corners.view]
    if side:
        places = places @ bundle.R.T + bundle.T
    lens = bundle.lenses[side]
    still = np.zeros(3)
    pixels, slopes = cv2.projectPoints(places, still, still, lens_matrix(lens), lens[PINHOLE:])
    slopes = slopes.reshape(len(places), 2, -1)  # by rotation, translation, fx fy, cx cy, distortion
    return pixels.reshape(-1, 2), slopes[:, :, 6 : 6 + len(lens)], slopes[:, :, 3:6], places


def linearise(bundle: Bundle, corners: tuple[Corners, Corners]) -> Normal:
    """The normal equations at `bundle`; rotations change by a small turn in the frame that they lead to."""
    views, size = len(bundle.rotations), bundle.shared
    normal = Normal(
        np.zeros((views, size, size)),
        np.zeros((views, size)),
        np.zeros((views, size, POSE)),
        np.zeros((views, POSE, POSE)),
        np.zeros((views, POSE)),
        0.0,
    )
    for side, ours in enumerate(corners):
        if not len(ours.seen):  # one camera by itself
            continue
        pixels, by_shared, by_pose = jacobian(bundle, ours, side)
        off = pixels - ours.seen
        normal.squares += float((off**2).sum())
        ends = np.searchsorted(ours.view, np.arange(views + 1))
        for view, (first, last) in enumerate(pairwise(ends)):
            shared, pose = by_shared[first:last].reshape(-1, size), by_pose[first:last].reshape(-1, POSE)
            rest = off[first:last].reshape(-1)
            normal.shared[view] += shared.T @ shared
            normal.cross[view] += shared.T @ pose
            normal.pose[view] += pose.T @ pose
            normal.gradient[view] += shared.T @ rest
            normal.pose_gradient[view] += pose.T @ rest
    return normal


def jacobian(bundle: Bundle, corners: Corners, side: int) -> tuple[Doubles, Doubles, Doubles]:
    """(m, 2) px where the corners are put, (m, 2, P) by the shared numbers, (m, 2, 6) by the pose of the view."""
    pixels, by_lens, by_place, places = project(bundle, corners, side)
    by_shared = np.zeros((len(places), 2, bundle.shared))
    start = side * len(bundle.lenses[0])
    by_shared[:, :, start : start + len(bundle.lenses[side])] = by_lens
    turned = np.einsum("mij,mj->mi", bundle.rotations[corners.view], corners.points)
    if side:
        by_shared[:, :, -3:] = by_place
        by_shared[:, :, -6:-3] = _turning(by_place, places - bundle.T)
        by_place = by_place @ bundle.R
    return pixels, by_shared, np.concatenate([_turning(by_place, turned), by_place], axis=2)


def refine(
    bundle: Bundle, corners: tuple[Corners, Corners], *, poses_only: bool = False, settled: float = SETTLED
) -> Bundle:
    """Fit all unknowns, or the poses alone, to the corners (Levenberg and Marquardt).

    Args:
        bundle: where to start.
        corners: of the left and of the right camera.
        poses_only: keep what the views share.
        settled: part of the sum of squares; a step that gains less is the last one.

    Raises:
        CalibrationError: the corners do not determine them.
    """
    damping = FIRST_DAMPING
    normal = linearise(bundle, corners)
    for _ in range(MOST_STEPS):
        gained = 0.0
        while damping <= MOST_DAMPING:
            tried = _step(bundle, normal, damping, poses_only)
            squares = sum(float((off**2).sum()) for off in residuals(tried, corners))
            gained = normal.squares - squares
            if gained >= 0:  # never where it is not finite
                break
            damping *= 10
        else:
            break
        bundle, before = tried, normal.squares
        if gained <= settled * before:
            break
        normal, damping = linearise(bundle, corners), max(damping / 10, LEAST_DAMPING)
    return bundle


def scaled_inverse(matrix: Doubles) -> Doubles:
    """Inverse of a positive definite matrix whose rows have units of very different sizes.

    What rounding alone determines comes out as huge as it is uncertain, and leaves the rest as it is.

    Raises:
        CalibrationError: a row is empty or not finite: nothing was seen of something.
    """
    scale = np.sqrt(np.diag(matrix))
    if not (np.isfinite(matrix).all() and (scale > 0).all()):
        raise _undetermined()
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    values = np.maximum(values, len(values) * np.finfo(np.float64).eps * values[-1])
    inverse: Doubles = (vectors / values) @ vectors.T / np.outer(scale, scale)
    return inverse


def _solve(matrix: Doubles, right: Doubles) -> Doubles:
    try:
        solved: Doubles = np.asarray(np.linalg.solve(matrix, right), np.float64)
    except np.linalg.LinAlgError as error:  # a view's corners do not even determine its own pose
        raise _undetermined() from error
    return solved


def _undetermined() -> CalibrationError:
    return CalibrationError(
        "the boards do not determine the cameras: tilt the board in more directions, fill more of the picture"
    )


def _turning(by_place: Doubles, arms: Doubles) -> Doubles:
    """(m, 2, 3): derivative by a small turn w, which moves the end of an arm by w x arm."""
    turning: Doubles = np.cross(arms[:, None, :], by_place)
    return turning


def _step(bundle: Bundle, normal: Normal, damping: float, poses_only: bool) -> Bundle:
    """One damped Gauss-Newton step."""
    damped = replace(normal, pose=_damped(normal.pose, damping))
    shift = np.zeros(bundle.shared)
    if not poses_only:
        information, gradient = damped.reduced()
        total = information.sum(axis=0)
        total[np.diag_indices_from(total)] += damping * np.einsum("vii->i", normal.shared)
        scale = np.sqrt(np.diag(total))
        if not (np.isfinite(scale).all() and (scale > 0).all()):
            raise _undetermined()
        shift = -np.linalg.lstsq(total / np.outer(scale, scale), gradient.sum(axis=0) / scale, rcond=None)[0] / scale
    moves = -_solve(damped.pose, (normal.pose_gradient + np.einsum("vpi,p->vi", normal.cross, shift))[..., None])[
        ..., 0
    ]
    first, second = len(bundle.lenses[0]), len(bundle.lenses[0]) + len(bundle.lenses[1])
    return Bundle(
        lenses=(bundle.lenses[0] + shift[:first], bundle.lenses[1] + shift[first:second]),
        R=cv2.Rodrigues(shift[-6:-3])[0] @ bundle.R,
        T=bundle.T + shift[-3:],
        rotations=np.stack([cv2.Rodrigues(move[:3])[0] for move in moves]) @ bundle.rotations,
        translations=bundle.translations + moves[:, 3:],
    )


def _damped(blocks: Doubles, damping: float) -> Doubles:
    diagonal = np.einsum("vii->vi", blocks)
    raised: Doubles = blocks + damping * np.einsum("vi,ij->vij", diagonal, np.eye(blocks.shape[1]))
    return raised
