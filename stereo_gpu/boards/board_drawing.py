"""A board as rectangles of true size, from which every kind of print is made."""

from __future__ import annotations

import numpy as np

from stereo_gpu.boards.board import Board
from stereo_gpu.boards.charuco import CharucoBoard
from stereo_gpu.boards.markers import draw_marker, marker_squares
from stereo_gpu.types import Bytes, Doubles


def black_rectangles(board: Board) -> Doubles:
    """(n, 4) x, y, width and height of what is black, in the board's unit, from its top left corner, y down.

    The top left square is black; markers stand in the white ones.
    """
    y, x = np.divmod(np.arange(board.columns * board.rows), board.columns)
    black = (x + y) % 2 == 0
    squares = np.column_stack([x[black], y[black], np.ones((black.sum(), 2))]) * board.square
    if not isinstance(board, CharucoBoard):
        return np.asarray(squares, np.float64)
    gap = (board.square - board.marker) / 2
    parts = [squares]
    for number, place in enumerate(marker_squares(board.columns, board.rows)):
        cells = draw_marker(board.dictionary, number)
        runs = _black_runs(cells) * (board.marker / len(cells))
        runs[:, :2] += place * board.square + gap
        parts.append(runs)
    return np.concatenate(parts)


def cells_across(board: Board) -> int:
    """How many cells a marker has along its side; 0 without markers."""
    return len(draw_marker(board.dictionary, 0)) if isinstance(board, CharucoBoard) else 0


def _black_runs(cells: Bytes) -> Doubles:
    """(n, 4) x, y, width and height of the black runs of each row, in cells."""
    runs = []
    for row, line in enumerate(cells == 0):
        ends = np.flatnonzero(np.diff(np.concatenate([[False], line, [False]]).astype(np.int8)))
        runs += [(first, row, last - first, 1) for first, last in zip(ends[::2], ends[1::2], strict=True)]
    return np.array(runs, np.float64).reshape(-1, 4)
