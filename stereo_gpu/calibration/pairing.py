"""Which corner of the left board is which of the right one, and roughly how the cameras stand.

A board turned by 180 degrees looks the same where its colours allow it (a square one already at 90), so that
the finder may start at another corner in the other camera. One camera alone cannot tell. Two can: only with
the right orders do all views agree on one R and T. A board whose markers name its corners has one order only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_gpu.boards.board import Board, BoardView, in_both
from stereo_gpu.types import Doubles

MOST_HYPOTHESES = 40  # views whose R and T are tried; the work grows with their number times that of all views


@dataclass(frozen=True, kw_only=True)
class LensView:
    """What one camera's own calibration says of one view.

    Args:
        seen: what the picture shows of the board.
        rotation: (3, 3), board to camera frame.
        translation: (3,), in the board's unit.
    """

    seen: BoardView
    rotation: Doubles
    translation: Doubles


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """The R and T on which most views agree.

    Args:
        right: what the right camera saw in each view, with the ids that the left one gave the same corners.
        R, T: X_right = R X_left + T, from a single view, so that it is a start and no more.
        errors_px: (views,) rms distance between right corners and the left board carried over.
    """

    right: list[BoardView]
    R: Doubles
    T: Doubles
    errors_px: Doubles


@dataclass(frozen=True, kw_only=True)
class Proposals:
    """Every R and T that a single view proposes, and how all views take it.

    Args:
        view: (proposals,) which view made it.
        R, T: (proposals, 3, 3) and (proposals, 3).
        candidates: of every view, what the right camera saw, with the ids of each order.
        errors_px: (proposals, views, orders) rms distance between right corners and the left board carried over.
    """

    view: NDArray[np.intp]
    R: Doubles
    T: Doubles
    candidates: list[list[BoardView]]
    errors_px: Doubles

    def agreement(self) -> Agreement:
        """The proposal with the lowest median error over all views, so that up to half of them may be wrong."""
        best = int(np.median(self.errors_px.min(axis=2), axis=1).argmin())
        errors = self.errors_px[best]
        return Agreement(
            right=[several[order] for several, order in zip(self.candidates, errors.argmin(axis=1), strict=True)],
            R=self.R[best],
            T=self.T[best],
            errors_px=errors.min(axis=1),
        )


def propose(
    left: Sequence[LensView], right: Sequence[LensView], board: Board, matrix: Doubles, distortion: Doubles
) -> Proposals:
    """Let every view, with every order that the board's symmetry allows, propose an R and T.

    Args:
        left, right: the same views, seen by either camera, with corners in common.
        board: what they show.
        matrix, distortion: of the right camera.
    """
    points = board.points.astype(np.float64)
    orders = _orders(board)
    candidates = [[_renamed(view.seen, order) for order in orders] for view in right]
    common = [[in_both(view.seen, seen)[1] for seen in several] for view, several in zip(left, candidates, strict=True)]
    views, rotations, translations, errors = [], [], [], []
    for number in np.unique(np.linspace(0, len(left) - 1, MOST_HYPOTHESES).astype(int)):
        for order in orders:
            rotation, translation = _relative(left[number], right[number], points, order, board)
            views.append(number)
            rotations.append(rotation)
            translations.append(translation)
            errors.append(
                [
                    [_error(view, seen, points, rotation, translation, matrix, distortion) for seen in several]
                    for view, several in zip(left, common, strict=True)
                ]
            )
    return Proposals(
        view=np.array(views),
        R=np.stack(rotations),
        T=np.stack(translations),
        candidates=candidates,
        errors_px=np.array(errors),
    )


def _orders(board: Board) -> list[NDArray[np.intp]]:
    """The orders in which the same corners can be listed; the one as found comes first."""
    columns, rows = board.corners
    grid = np.arange(columns * rows).reshape(rows, columns)
    return [np.rot90(grid, turn).reshape(-1) for turn in board.turns]


def _renamed(seen: BoardView, order: NDArray[np.intp]) -> BoardView:
    """The same corners with the ids that they have if the board's are listed in `order`."""
    ids = np.argsort(order)[seen.ids].astype(np.int32)
    rising = np.argsort(ids)
    return replace(seen, corners=seen.corners[rising], ids=ids[rising])


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


def _error(
    left: LensView,
    seen: BoardView,
    points: Doubles,
    rotation: Doubles,
    translation: Doubles,
    matrix: Doubles,
    distortion: Doubles,
) -> float:
    """Rms px between the board as the left camera sees it, carried over, and the right corners that both have seen."""
    if not len(seen.ids):
        return np.inf
    carried = (points[seen.ids] @ left.rotation.T + left.translation) @ rotation.T + translation
    if (carried[:, 2] <= 0).any():  # behind the right camera
        return np.inf
    projected, _ = cv2.projectPoints(carried, np.zeros(3), np.zeros(3), matrix, distortion)
    return float(np.sqrt(((seen.corners - projected.reshape(-1, 2)) ** 2).sum(-1).mean()))
