"""Triangles of single cells of the pixel lattice, the squares between four neighbouring pixels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.types import Floats, Ints


def dense_triangles(values: Floats, max_jump_px: float) -> Ints:
    """(M, 3) faces over flat pixel indices: both halves of every cell, cut at jumps; NaN has no value."""
    height, width = values.shape
    cells = np.arange((height - 1) * width, dtype=np.int32).reshape(height - 1, width)[:, :-1]
    return cell_triangles(values, cells.ravel(), max_jump_px)


def cell_triangles(values: Floats, cells: Ints, max_jump_px: float) -> Ints:
    """Join the corners of cells into triangles wherever they show the same surface.

    Four neighbouring pixels lie on one circle, so either diagonal of their square is Delaunay: the one with the
    smaller step in disparity is taken, which lets edges of objects run between triangles. Where only three of the
    four have a value, they make one triangle.

    Args:
        values: (H, W) float32 disparity, px; NaN where there is none.
        cells: (N,) flat indices of the cells' upper left pixels.
        max_jump_px: no triangle whose corners differ by more than this.

    Returns:
        (M, 3) faces over flat pixel indices, counter-clockwise as seen, from the corner at the right angle on.
    """
    width = np.int32(values.shape[1])
    flat = values.ravel()
    # a b   A cell's corners. Comparisons with NaN are false: no value, no triangle.
    # c d
    ia, ib, ic, id_ = cells, cells + 1, cells + width, cells + width + 1
    a, b, c, d = (flat[index] for index in (ia, ib, ic, id_))
    with np.errstate(invalid="ignore"):
        ab, ac, bd, cd = (abs(p - q) <= max_jump_px for p, q in ((a, b), (a, c), (b, d), (c, d)))
        ad, bc = abs(a - d), abs(b - c)
        # A triangle that lacks its fourth corner is on the only diagonal that exists.
        falling = (ad <= bc) | np.isnan(bc)
        rising = ~falling
        falling &= ad <= max_jump_px
        rising &= bc <= max_jump_px
    triangles = (
        (falling & ac & cd, (ic, id_, ia)),
        (falling & ab & bd, (ib, ia, id_)),
        (rising & ab & ac, (ia, ic, ib)),
        (rising & bd & cd, (id_, ib, ic)),
    )
    return join([np.stack([i[keep] for i in index], axis=1) for keep, index in triangles])


def half_cells(values: Floats, cells: Ints, corner: int, max_jump_px: float) -> Ints:
    """The one half of each cell that has its right angle at a corner (0 to 3: a, b, c, d), cut at jumps."""
    width = values.shape[1]
    offsets = (0, 1, width, width + 1)
    order = ((0, 2, 1), (1, 0, 3), (2, 3, 0), (3, 1, 2))[corner]
    faces = np.stack([cells + np.int32(offsets[i]) for i in order], axis=1)
    p, q, r = values.ravel()[faces].T
    with np.errstate(invalid="ignore"):
        keep = (abs(p - q) <= max_jump_px) & (abs(q - r) <= max_jump_px) & (abs(r - p) <= max_jump_px)
    return np.asarray(faces[keep], np.int32)


def join(parts: list[NDArray[np.int32]]) -> Ints:
    """Faces of several lists in one."""
    return np.concatenate(parts) if parts else np.zeros((0, 3), np.int32)
