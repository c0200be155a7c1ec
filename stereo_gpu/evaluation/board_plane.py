"""The true disparity of a flat board, everywhere on it: from its corners, which both cameras see."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stereo_gpu.boards.board import Board, in_both
from stereo_gpu.errors import StageError
from stereo_gpu.rectify import Rectification, plan_rectification
from stereo_gpu.rig import Camera, Rig
from stereo_gpu.types import Bytes, Doubles, Floats, Picture

ROUNDS = 20  # of reweighting; the plane stands still long before
HUBER_PX = 0.3  # residuals up to here count in full; corners are found to about 0.1 px


@dataclass(frozen=True, kw_only=True)
class BoardPlane:
    """Where a board is on the rectified left view, and what its disparity is there.

    Args:
        truth: (H, W) float32, px, NaN outside of the outline of the whole board as printed, and where the other camera
            sees it no more.
        outline: (4, 2) px, the board's corners on the rectified left view.
        plane: (3,) a, b, c of disparity = a x + b y + c: on a plane it is affine in the rectified pixel.
        residuals: (N,) px, the inner corners' disparities less the plane's.
        rows: (N,) px, by how much rectified corners of left and right differ in height.
    """

    truth: Floats
    outline: Doubles
    plane: Doubles
    residuals: Doubles
    rows: Doubles

    @property
    def span(self) -> tuple[float, float]:
        """Smallest and largest disparity on the board, px."""
        return float(np.nanmin(self.truth)), float(np.nanmax(self.truth))


def find_plane(left: Picture, right: Picture, rig: Rig, board: Board) -> BoardPlane:
    """Find a board's plane and outline in a raw pair.

    The inner corners are found in both pictures and moved to the rectified ones through the calibration. The plane is
    fitted to their disparities, with less weight for those off it, and not through the pose of the board: that would
    add the errors of the lens model at each corner, up to some tenths of a pixel.

    Args:
        left, right: raw pictures of the rig's cameras.
        rig: the calibrated cameras.
        board: what they show.

    Raises:
        StageError: the board is not found in both pictures.
    """
    found = board.find(left), board.find(right)
    if found[0] is None or found[1] is None:
        raise StageError(f"no whole board of {board} squares in both pictures: give a pair that shows one")
    seen = in_both(found[0], found[1])
    plan = plan_rectification(rig)
    ours = _rectified(seen[0].corners, rig.left, plan.rotation_left, plan.cx_left, plan)
    theirs = _rectified(seen[1].corners, rig.right, plan.rotation_right, plan.cx_right, plan)
    # Each picture may have been read from either end of a checkerboard; in the right order, rows correspond.
    orders = [theirs, theirs[::-1]] if 2 in board.turns else [theirs]
    theirs = min(orders, key=lambda order: float(np.abs(order - ours)[:, 1].mean()))
    disparity = ours[:, 0] - theirs[:, 0]
    plane = _fit(ours, disparity)
    # A plane that a pinhole camera sees: exactly a homography, so that the outline follows from the inner corners.
    to_view = cv2.findHomography(board.points[seen[0].ids, :2].astype(np.float64), ours)[0]
    columns, rows = board.corners
    ends = np.array([[-1, -1], [columns, -1], [columns, rows], [-1, rows]], np.float64) * board.square
    outline = cv2.perspectiveTransform(ends[:, None], to_view)[:, 0]
    return BoardPlane(
        truth=_truth(plane, outline, plan),
        outline=outline,
        plane=plane,
        residuals=disparity - _at(plane, ours),
        rows=ours[:, 1] - theirs[:, 1],
    )


def visible(plane: BoardPlane, valid_left: Bytes, valid_right: Bytes) -> Floats:
    """The truth without the pixels where one of the rectified pictures has no content, (H, W) px."""
    seen = valid_left != 0
    rows, columns = np.nonzero(np.isfinite(plane.truth))
    partners = np.rint(columns - plane.truth[rows, columns]).astype(int)
    seen[rows, columns] &= valid_right[rows, partners] != 0
    return np.where(seen, plane.truth, np.float32(np.nan))


def _rectified(corners: Floats, camera: Camera, rotation: Doubles, cx: float, plan: Rectification) -> Doubles:
    """Corners of a raw picture on the rectified one, (N, 2) px."""
    matrix = np.array([[plan.focal_px, 0, cx], [0, plan.focal_px, plan.cy], [0, 0, 1]])
    raw = corners.reshape(-1, 1, 2).astype(np.float64)
    moved: Doubles = cv2.undistortPoints(raw, camera.matrix, camera.distortion, R=rotation, P=matrix)[:, 0]
    return moved


def _fit(places: Doubles, disparity: Doubles) -> Doubles:
    """Least squares, reweighted as Huber has it."""
    terms = np.column_stack([places, np.ones(len(places))])
    weights = np.ones(len(places))
    for _ in range(ROUNDS):
        root = np.sqrt(weights)
        plane: Doubles = np.linalg.lstsq(terms * root[:, None], disparity * root, rcond=None)[0]
        off = np.abs(disparity - terms @ plane)
        weights = HUBER_PX / np.maximum(off, HUBER_PX)
    return plane


def _at(plane: Doubles, places: Doubles) -> Doubles:
    return np.asarray(places @ plane[:2] + plane[2])


def _truth(plane: Doubles, outline: Doubles, plan: Rectification) -> Floats:
    """The plane's disparity at the pixel centres inside of the outline whose partner lies in the other picture."""
    width, height = plan.size
    x, y = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    disparity = _at(plane, np.stack([x, y], axis=-1))
    sides = np.roll(outline, -1, axis=0) - outline
    # A convex outline: inside is what lies on the same hand of all four sides.
    hands = np.stack(
        [side[0] * (y - corner[1]) - side[1] * (x - corner[0]) for corner, side in zip(outline, sides, strict=True)]
    )
    inside = (hands >= 0).all(axis=0) | (hands <= 0).all(axis=0)
    partner = x - disparity
    inside &= (partner >= 0) & (partner <= width - 1)
    return np.where(inside, disparity, np.nan).astype(np.float32)
