"""How sharp a board is in a picture: the width of the edges between its squares."""

from __future__ import annotations

from typing import Protocol

import cv2
import numpy as np

from stereo_gpu.boards.board import BoardView
from stereo_gpu.types import Bytes, Doubles

SAMPLES = 33  # across an edge
ALONG = (-0.12, 0.0, 0.12)  # of an edge's length from its middle: three profiles are averaged
MOST_EDGES = 1000  # a median needs no more
FAINT = 12.0  # grey levels between the squares, below which an edge tells nothing
REACH = 0.35  # of a square to either side; farther off lies the next edge


class Grid(Protocol):
    """A board whose inner corners stand in rows and columns."""

    @property
    def corners(self) -> tuple[int, int]:
        """Columns and rows of inner corners."""
        ...


def edge_width(picture: Bytes, view: BoardView, board: Grid, reach: float = REACH) -> float:
    """Distance over which the grey value climbs from 10 to 90 % across the edges of a board's squares, px.

    Measured across the middle of every edge between two corners in view, for both directions of edges, since a
    moving hand blurs only what lies across its way; as in ISO 12233, but with no model of the edge.

    Args:
        picture: (H, W) uint8.
        view: the corners; half a pixel off does no harm.
        board: how many columns and rows of inner corners the board has.
        reach: how far to look to either side, as a share of the square; wider edges count as wide as 1.6 times that.

    Returns:
        The median width of the blurrier direction; 1 to 3 px is sharp, NaN where no edge can be measured.
    """
    columns, rows = board.corners
    known = np.full((rows * columns, 2), np.nan)
    known[view.ids] = view.corners
    grid = known.reshape(rows, columns, 2)
    widths = [
        _widths(picture, grid[:, :-1].reshape(-1, 2), grid[:, 1:].reshape(-1, 2), reach),
        _widths(picture, grid[:-1].reshape(-1, 2), grid[1:].reshape(-1, 2), reach),
    ]
    return max((float(np.median(found)) for found in widths if len(found)), default=float("nan"))


def _widths(picture: Bytes, starts: Doubles, ends: Doubles, reach: float) -> Doubles:
    """(n,) px, of the edges from `starts` to `ends` (N, 2) that are in view and have contrast."""
    known = np.isfinite(starts).all(axis=1) & np.isfinite(ends).all(axis=1)
    if not known.any():
        return np.empty(0)
    step = 1 + np.count_nonzero(known) // MOST_EDGES
    starts, ends = starts[known][::step], ends[known][::step]
    along = ends - starts
    length = np.linalg.norm(along, axis=1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)  # as long as the edge
    steps = np.linspace(-reach, reach, SAMPLES)
    middles = (starts + ends)[:, None] / 2 + along[:, None] * np.array(ALONG)[:, None]  # (n, 3, 2)
    at = (middles[:, :, None] + across[:, None, None] * steps[:, None]).astype(np.float32)  # (n, 3, SAMPLES, 2)
    flat = at.reshape(-1, len(ALONG) * SAMPLES, 2)
    values = cv2.remap(picture, flat, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    profiles = values.reshape(at.shape[:3]).astype(np.float64).mean(axis=1)
    outer = max(1, SAMPLES // 10)
    low, high = profiles[:, :outer].mean(axis=1), profiles[:, -outer:].mean(axis=1)
    clear = np.abs(high - low) >= FAINT
    height = (profiles[clear] - low[clear, None]) / (high - low)[clear, None]
    climbing = ((height > 0.1) & (height < 0.9)).mean(axis=1)
    widths: Doubles = climbing * 2 * reach * length[clear]
    return widths
