"""Where to hold the board next: of many ways, the one after which depth would be the most certain.

A view's information about the cameras does not depend on what the picture will show, only on where the board is
held, so that what each candidate would bring is known before it is taken (optimal design of experiments; for
calibration Rojtberg and Kuijper, "Efficient Pose Selection for Interactive Camera Calibration", 2018).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np

from stereo_gpu.boards.board import Board
from stereo_gpu.calibration.bundle import Bundle, Corners, linearise, project, scaled_inverse
from stereo_gpu.calibration.uncertainty import depth_deviations, depth_slopes
from stereo_gpu.types import Doubles

LEAST_GAIN = 0.05  # of the depth's deviation: less is not worth a picture
FILLS = (("near", 0.7), ("at middle distance", 0.45), ("far", 0.28))  # share of the picture's side that the board takes
TILTS = (  # words, degrees about x, about y
    ("facing the cameras", 0, 0),
    ("tilted by 30 degrees, top edge towards the cameras", 30, 0),
    ("tilted by 30 degrees, bottom edge towards the cameras", -30, 0),
    ("tilted by 30 degrees, right edge towards the cameras", 0, 30),
    ("tilted by 30 degrees, left edge towards the cameras", 0, -30),
    ("tilted by 45 degrees, right edge towards the cameras", 0, 45),
    ("tilted by 45 degrees, left edge towards the cameras", 0, -45),
)
ROWS, COLUMNS = ("top", "", "bottom"), ("left", "", "right")
OUTWARD = (0.9, 0.75, 0.6, 0.45, 0.3, 0.15)  # of half the picture: how far to that side, the farthest first
MARGIN = 0.02  # of the picture's width, that the corners keep from its edge
MOST_CORNERS = 100  # of the board that are looked at


@dataclass(frozen=True, kw_only=True)
class NextView:
    """The next best view.

    Args:
        place: where in both pictures, such as "at the bottom right of both pictures".
        distance: of the board's middle along z, in the board's unit.
        near: how near that is, in words.
        tilt: how it leans, in words.
        gain: by what part depth would be more certain.
        rotation, translation: (3, 3) and (3,), board to left camera frame.
    """

    place: str
    distance: float
    near: str
    tilt: str
    gain: float
    rotation: Doubles
    translation: Doubles

    def told(self, unit: str) -> str:
        """In one sentence."""
        distance = float(f"{self.distance:.2g}")
        return (
            f"next: hold the board {self.place}, {self.near} (about {distance:,g} {unit}), {self.tilt}:"
            f" depth would be {self.gain:.0%} more certain"
        )


def find_next_view(
    bundle: Bundle,
    information: Doubles,
    places: Doubles,
    sizes: Sequence[tuple[int, int]],
    board: Board,
) -> NextView | None:
    """The view that would bring the most; None where no view brings much.

    Args:
        bundle: the fit.
        information: (P, P) of what all views share, from all views so far, per px² of variance.
        places: (k, 3) where depth is to be certain, left camera's frame.
        sizes: of the left and the right pictures, px.
        board: what is held.
    """
    candidates = _candidates(bundle, sizes, board)
    if not candidates:
        return None
    points = _thinned(board)
    trial = Bundle(
        bundle.lenses,
        bundle.R,
        bundle.T,
        np.stack([held.rotation for held in candidates]),
        np.stack([held.translation for held in candidates]),
    )
    view = np.repeat(np.arange(len(candidates), dtype=np.int32), len(points))
    corners = Corners(view, np.tile(points, (len(candidates), 1)), np.zeros((len(view), 2)))
    brought, _ = linearise(trial, (corners, corners)).reduced()
    brought *= len(board.points) / len(points)
    slopes = depth_slopes(bundle, places)
    scale = np.sqrt(np.diag(information))
    even, scaled = information / np.outer(scale, scale), slopes / scale

    def certainty(more: Doubles) -> float:
        # The mean of logarithms: every place counts by what it gains, or the worst ones alone would decide. A corner's
        # variance is left out, since only differences count.
        covariance = scaled_inverse(even + more / np.outer(scale, scale))
        return -float(np.log(depth_deviations(scaled, covariance)).mean())

    later = np.array([certainty(more) for more in brought])
    best = int(later.argmax())
    gain = 1 - np.exp(certainty(np.zeros_like(even)) - later[best])
    if not gain >= LEAST_GAIN:
        return None
    held = candidates[best]
    return NextView(
        place=held.place,
        distance=held.distance,
        near=held.near,
        tilt=held.tilt,
        gain=float(gain),
        rotation=held.rotation,
        translation=held.translation,
    )


def _thinned(board: Board) -> Doubles:
    """Corners spread evenly over the board, not more than are needed."""
    points = board.points.astype(np.float64)
    thinned: Doubles = points[np.unique(np.linspace(0, len(points) - 1, MOST_CORNERS).astype(int))]
    return thinned


def _candidates(bundle: Bundle, sizes: Sequence[tuple[int, int]], board: Board) -> list[NextView]:
    """Ways to hold the board that lie in both pictures, at each side as far out as possible."""
    points = board.points.astype(np.float64)
    low, high = points.min(axis=0), points.max(axis=0)
    middle, extent = (low + high) / 2, (high - low)[:2] + 2 * board.square
    rim = np.array([(x, y, 0) for x, y in product((low[0], middle[0], high[0]), (low[1], middle[1], high[1]))])
    focal = bundle.lenses[0][:2]
    size = np.array(sizes[0], np.float64)
    found = []
    for (near, fill), (tilt, about_x, about_y) in product(FILLS, TILTS):
        distance = float((focal * extent / (fill * size)).max())
        centre = _centre(bundle, sizes, distance)
        rotation = cv2.Rodrigues(np.deg2rad([float(about_x), float(about_y), 0.0]))[0]
        for row, column in product((-1, 0, 1), (-1, 0, 1)):
            for outward in OUTWARD if row or column else (0.0,):
                reach = outward * size / 2 / focal * distance
                place = centre + np.array([column * reach[0], row * reach[1], 0])
                held = NextView(
                    place=_place(row, column),
                    distance=distance,
                    near=near,
                    tilt=tilt,
                    gain=0.0,
                    rotation=rotation,
                    translation=place - rotation @ middle,
                )
                if _in_both(bundle, held, rim, sizes):
                    found.append(held)
                    break
    return found


def _centre(bundle: Bundle, sizes: Sequence[tuple[int, int]], distance: float) -> Doubles:
    """The middle of what both cameras see at a distance, left camera's frame."""
    rays = []
    for lens, (width, height) in zip(bundle.lenses, sizes, strict=True):
        fx, fy, cx, cy = lens[:4]
        rays.append(np.array([(width / 2 - cx) / fx, (height / 2 - cy) / fy, 1.0]))
    right = bundle.R.T @ (distance * rays[1] - bundle.T)
    centre = (distance * rays[0] + right) / 2
    centre[2] = distance
    return centre


def _in_both(bundle: Bundle, held: NextView, rim: Doubles, sizes: Sequence[tuple[int, int]]) -> bool:
    pose = Bundle(bundle.lenses, bundle.R, bundle.T, held.rotation[None], held.translation[None])
    corners = Corners(np.zeros(len(rim), np.int32), rim, np.zeros((len(rim), 2)))
    for side, size in enumerate(sizes):
        pixels, _, _, places = project(pose, corners, side)
        margin = MARGIN * size[0]
        if not ((places[:, 2] > 0).all() and (pixels >= margin).all() and (pixels < np.array(size) - margin).all()):
            return False
    return True


def _place(row: int, column: int) -> str:
    words = " ".join(word for word in (ROWS[row + 1], COLUMNS[column + 1]) if word)
    return f"at the {words} of both pictures" if words else "in the middle of both pictures"
