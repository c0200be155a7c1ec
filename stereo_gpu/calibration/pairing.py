"""Which corner of the left board is which of the right one, and roughly how the cameras stand.

A board turned by 180 degrees looks the same where its colours allow it (a square one already at 90), so that
the finder may start at another corner in the other camera. One camera alone cannot tell. Two can: only with
the right orders do all views agree on one R and T.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_gpu.calibration.board import Board
from stereo_gpu.types import Doubles, Floats

MOST_HYPOTHESES = 40  # views whose R and T are tried; the work grows with their number times that of all views


@dataclass(frozen=True, kw_only=True)
class LensView:
    """What one camera's own calibration says of one view.

    Args:
        corners: (N, 2), px.
        rotation: (3, 3), board to camera frame.
        translation: (3,), in the board's unit.
    """

    corners: Floats
    rotation: Doubles
    translation: Doubles


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """The R and T on which most views agree.

    Args:
        right: the right camera's corners of each view, (N, 2), in the order of the left ones.
        R, T: X_right = R X_left + T, from a single view, so that it is a start and no more.
        errors_px: (views,) rms distance between right corners and the left board carried over.
    """

    right: list[Floats]
    R: Doubles
    T: Doubles
    errors_px: Doubles


def pair_corners(
    left: Sequence[LensView], right: Sequence[LensView], board: Board, matrix: Doubles, distortion: Doubles
) -> Agreement:
    """Put the right corners of every view into the order of the left ones.

    Every view, with every order that the board's symmetry allows, proposes an R and T; the proposal with the
    lowest median error over all views wins, so that up to half of them may be wrong.

    Args:
        left, right: the same views, seen by either camera.
        board: what they show.
        matrix, distortion: of the right camera.
    """
    points = board.points.astype(np.float64)
    orders = _orders(board)
    # corners[view, order]: (views, orders, N, 2)
    corners = np.stack([[view.corners[order] for order in orders] for view in right]).astype(np.float64)
    best: tuple[float, Doubles, Doubles, Doubles] | None = None
    for number in np.unique(np.linspace(0, len(left) - 1, MOST_HYPOTHESES).astype(int)):
        for order in orders:
            rotation, translation = _relative(left[number], right[number], points, order, board)
            errors = np.stack(
                [
                    _errors(view, points, seen, rotation, translation, matrix, distortion)
                    for view, seen in zip(left, corners, strict=True)
                ]
            )
            score = float(np.median(errors.min(axis=1)))
            if best is None or score < best[0]:
                best = score, rotation, translation, errors
    assert best is not None  # there is at least one view
    _, rotation, translation, errors = best
    chosen = errors.argmin(axis=1)
    return Agreement(
        right=[view.corners[orders[order]] for view, order in zip(right, chosen, strict=True)],
        R=rotation,
        T=translation,
        errors_px=errors.min(axis=1),
    )


def _orders(board: Board) -> list[NDArray[np.intp]]:
    """The orders in which the same corners can be listed; the one as found comes first."""
    columns, rows = board.corners
    grid = np.arange(columns * rows).reshape(rows, columns)
    turns = (0, 1, 2, 3) if columns == rows else (0, 2)
    return [np.rot90(grid, turn).reshape(-1) for turn in turns]


def _relative(
    left: LensView, right: LensView, points: Doubles, order: NDArray[np.intp], board: Board
) -> tuple[Doubles, Doubles]:
    """R and T that one view proposes if the right corners are listed in `order`."""
    # Listing the corners in another order turns the board in its own plane: point i lies where order[i] lay.
    origin = points[order[0]]
    along, down = ((points[order[step]] - origin) / np.linalg.norm(points[step]) for step in (1, board.corners[0]))
    turn = np.column_stack([along, down, np.cross(along, down)])
    rotation = right.rotation @ turn @ left.rotation.T
    return rotation, right.rotation @ origin + right.translation - rotation @ left.translation


def _errors(
    left: LensView,
    points: Doubles,
    right_corners: Doubles,
    rotation: Doubles,
    translation: Doubles,
    matrix: Doubles,
    distortion: Doubles,
) -> Doubles:
    """(orders,) rms px between the right corners and the board as the left camera sees it."""
    carried = (points @ left.rotation.T + left.translation) @ rotation.T + translation
    if (carried[:, 2] <= 0).any():  # behind the right camera
        return np.full(len(right_corners), np.inf)
    projected, _ = cv2.projectPoints(carried, np.zeros(3), np.zeros(3), matrix, distortion)
    off: Doubles = np.sqrt(((right_corners - projected.reshape(-1, 2)) ** 2).sum(-1).mean(-1))
    return off
