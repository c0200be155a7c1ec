"""Vertical errors over the frame: robust medians of its cells, and a smooth map between them."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stereo_gpu.types import Doubles, Floats, Ints

CELLS = (8, 6)  # columns, rows
ENOUGH = 3  # matches of a cell
REACH = 0.8  # cells: standard deviation of the weights of the smooth map
FULL = 10  # matches of a cell that count in full
FAINT = 0.11  # weight below which the map says nothing: about a cell from the next value


@dataclass(frozen=True, kw_only=True, eq=False)
class ErrorMap:
    """Vertical errors of the cells of the left picture.

    Args:
        values: (rows, columns) float64 px, the median of each cell's matches; NaN with fewer than ENOUGH.
        counts: (rows, columns), matches of each cell.
    """

    values: Doubles
    counts: Ints

    @property
    def share(self) -> float:
        """Share of the cells that hold a match."""
        return float((self.counts > 0).mean())


def map_errors(points_left: Doubles, vertical: Doubles, size: tuple[int, int]) -> ErrorMap:
    """Medians of the vertical errors (N,) px at (N, 2) px places of a picture of `size`, width and height."""
    columns, rows = CELLS
    cells = cells_of(points_left, size)
    counts = np.bincount(cells, minlength=columns * rows).astype(np.int32)
    values = np.full(columns * rows, np.nan)
    for cell in np.flatnonzero(counts >= ENOUGH):
        values[cell] = np.median(vertical[cells == cell])
    return ErrorMap(values=values.reshape(rows, columns), counts=counts.reshape(rows, columns))


def cells_of(points: Doubles, size: tuple[int, int]) -> Ints:
    """(N,) number of the cell, row by row, of (N, 2) px places in a picture of `size`, width and height."""
    columns, rows = CELLS
    places = ((points + 0.5) / size * CELLS).astype(np.int32)
    cells: Ints = np.clip(places[:, 1], 0, rows - 1) * columns + np.clip(places[:, 0], 0, columns - 1)
    return cells


def smooth(cells: ErrorMap, size: tuple[int, int]) -> Floats:
    """(H, W) px between the cells' medians, by weights that fall with distance; NaN far from every value."""
    known = np.isfinite(cells.values)
    # Zeros around the frame, so that its border is no mirror.
    edge = 3
    weight = np.pad(known * np.sqrt(np.minimum(cells.counts / FULL, 1.0)), edge)
    total = cv2.GaussianBlur(weight * np.pad(np.nan_to_num(cells.values), edge), (0, 0), REACH)
    weights = cv2.GaussianBlur(weight, (0, 0), REACH)
    inner = np.s_[edge:-edge, edge:-edge]
    total, weights = (cv2.resize(part[inner], size, interpolation=cv2.INTER_LINEAR) for part in (total, weights))
    return np.where(weights > FAINT, total / np.maximum(weights, 1e-9), np.nan).astype(np.float32)
