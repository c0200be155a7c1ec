"""Where in a picture a board lies, how large it is and how it leans, from one view and no calibration."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np

from stereo_gpu.boards.board import BoardView
from stereo_gpu.types import Doubles, Floats

GUESSED_FOCAL = (
    0.9  # of the picture's longer side: 58 degrees, as webcams have; 30 % off turns 30 degrees into 24 or 37
)
FEWEST_CORNERS = 6  # of a part of a board, from which its lean can be told
THIN = 0.02  # corners whose spread across is less than this share of that along lie on a line


class KnownPoints(Protocol):
    """A board of any kind, of which only the corners' places matter."""

    @property
    def points(self) -> Floats:
        """The inner corners on the board, (N, 3), z = 0."""
        ...


@dataclass(frozen=True, kw_only=True)
class Placement:
    """How a board is held, as one camera sees it.

    Args:
        x, y: the middle of the corners seen, 0..1 of the picture's width and height.
        size: square root of the share of the picture that all inner corners of the board would span, in view or not.
        lean_x: sine of the lean to the side; above 0 the board's right edge (in the picture) is nearer, below it the
            left one.
        lean_y: the same; above 0 the lower edge is nearer, below it the upper one.
    """

    x: float
    y: float
    size: float
    lean_x: float
    lean_y: float

    @property
    def lean_degrees(self) -> float:
        """Angle between the board and the picture's plane."""
        return math.degrees(math.asin(min(1.0, math.hypot(self.lean_x, self.lean_y))))


def place(view: BoardView, board: KnownPoints, size: tuple[int, int]) -> Placement | None:
    """How the board is held, from the homography of its corners (Zhang 2000, section 2) and a guessed focal length.

    The columns of K^-1 H are the board's own axes in the camera's frame, up to scale; their cross product is its
    normal. The principal point is taken as the picture's middle, the lens as free of distortion, which near the sides
    of a wide picture makes 10 degrees: good for telling one way of holding a board from another, not for measuring.

    Args:
        view: the corners that were seen.
        board: of which `points` (N, 3) says where they are on the board.
        size: width and height of the picture, px.

    Returns:
        None where the corners are fewer than six or lie on a line.
    """
    seen = np.asarray(view.corners, np.float64)
    on_board = np.asarray(board.points, np.float64)[view.ids, :2]
    if len(seen) < FEWEST_CORNERS or _thin(on_board) or _thin(seen):
        return None
    focal = GUESSED_FOCAL * max(size)
    middle = (np.array(size) - 1) / 2
    # In units of the focal length and of the board's own length, so that the equations are well scaled.
    length = float(np.ptp(board.points[:, :2], axis=0).max())
    origin = on_board.mean(axis=0)
    home, _ = cv2.findHomography((on_board - origin) / length, (seen - middle) / focal)
    if home is None or not np.isfinite(home).all() or abs(home[2, 2]) < 1e-9:
        return None
    home = home / home[2, 2]  # the seen corners' middle lies in front of the camera
    normal = np.cross(home[:, 0], home[:, 1])
    norm = float(np.linalg.norm(normal))
    # d(x, y) / d(board) at the corners' middle: how much larger the picture shows an area of the board.
    slope = home[:2, :2] - np.outer(home[:2, 2], home[2, :2])
    area = abs(float(np.linalg.det(slope))) * (focal / length) ** 2 * _area(np.asarray(board.points, np.float64))
    if norm < 1e-12 or not area > 0:
        return None
    normal = normal * math.copysign(1 / norm, -normal[2])  # towards the camera
    at = (seen.mean(axis=0) + 0.5) / np.array(size)
    return Placement(
        x=float(at[0]),
        y=float(at[1]),
        size=math.sqrt(area / (size[0] * size[1])),
        lean_x=-float(normal[0]),
        lean_y=-float(normal[1]),
    )


def _thin(points: Doubles) -> bool:
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] < THIN * spread[0] or spread[0] == 0)


def _area(points: Doubles) -> float:
    """Of the rectangle that the board's inner corners fill."""
    return float(np.prod(np.ptp(points[:, :2], axis=0)))
