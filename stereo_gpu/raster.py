"""Which triangle each pixel of a picture shows: a z-buffer in numpy, for machines without OpenGL.

Triangles are sorted into classes by the size of their bounding box, rounded up to powers of two, and each
class is tested as one array of triangles x pixels of the box. A pixel on a shared edge belongs to both
triangles and the nearer one wins, so a closed mesh shows no cracks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.types import Doubles, Floats, Ints

_CHUNK = 1 << 20  # triangles x pixels tested at once: about 30 MB of temporaries
_EDGE = 1e-5  # barycentric slack: float32 rounding must not open a crack along a shared edge
_FLAT = 1e-9  # twice the area in px^2 below which a triangle is seen edge on


@dataclass(frozen=True, kw_only=True)
class Fragments:
    """What the pixels show, one entry for each of the P pixels that show a triangle.

    Args:
        pixels: (P,) int64, y * width + x.
        triangles: (P,) int64, rows of `faces`.
        weights: (P, 3) float64, barycentric weights in space (perspective undone); each row sums to 1.
        edge_px: (P,) float32, distance to the nearest edge of the triangle in the picture, px.
        height_px: (P,) float32, smallest height of the triangle in the picture, px.
    """

    pixels: NDArray[np.int64]
    triangles: NDArray[np.int64]
    weights: Doubles
    edge_px: Floats
    height_px: Floats


def rasterise(screen: Doubles, depth: Doubles, faces: Ints, size: tuple[int, int]) -> Fragments:
    """Find the nearest triangle of every pixel.

    Args:
        screen: (N, 2) where each vertex falls in the picture, px, pixel centres at whole numbers.
        depth: (N,) distance along the optical axis, > 0 for all vertices that `faces` use.
        faces: (M, 3) vertex indices.
        size: (width, height) of the picture.
    """
    width, height = size
    corners = screen[faces]
    inverse_depth = 1.0 / depth[faces]
    low = np.maximum(np.ceil(corners.min(axis=1)), 0.0)
    high = np.minimum(np.floor(corners.max(axis=1)), (width - 1, height - 1))
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    seen = np.flatnonzero((high >= low).all(axis=1) & (np.abs(area) > _FLAT))
    corners, low, area = corners[seen], low[seen], area[seen, None]
    box = (high[seen] - low + 1).astype(np.int64)

    # Barycentric weight i is planes[i] . (x, y, 1), with x and y counted from the corner `low` of the box
    # so that float32 is exact enough in the inner loop.
    local = corners - low[:, None]
    after, before = np.roll(local, -1, axis=1), np.roll(local, -2, axis=1)
    planes = np.empty((len(seen), 3, 3))
    planes[..., 0] = (after[..., 1] - before[..., 1]) / area
    planes[..., 1] = (before[..., 0] - after[..., 0]) / area
    planes[..., 2] = (after[..., 0] * before[..., 1] - after[..., 1] * before[..., 0]) / area
    nearness = np.einsum("tik,ti->tk", planes, inverse_depth[seen]).astype(np.float32)
    planes32 = planes.astype(np.float32)

    nothing = np.uint64(0xFFFF_FFFF_FFFF_FFFF)
    nearest = np.full(width * height, nothing, np.uint64)
    steps = np.ceil(np.log2(np.maximum(box, 1))).astype(np.int64)
    kind = steps[:, 0] * 32 + steps[:, 1]
    for one in np.unique(kind):
        rows = np.flatnonzero(kind == one)
        columns, lines = 1 << (int(one) // 32), 1 << (int(one) % 32)
        y, x = np.divmod(np.arange(columns * lines), columns)
        grid = np.stack([x, y, np.ones_like(x)]).astype(np.float32)
        for begin in range(0, len(rows), max(1, _CHUNK // grid.shape[1])):
            _cover(
                rows[begin : begin + max(1, _CHUNK // grid.shape[1])],
                grid,
                planes32,
                nearness,
                low,
                size,
                nearest,
            )

    pixels = np.flatnonzero(nearest != nothing)
    rows = (nearest[pixels] & np.uint64(0xFFFF_FFFF)).astype(np.int64)
    y, x = np.divmod(pixels, width)
    where = np.stack([x - low[rows, 0], y - low[rows, 1], np.ones(len(rows))], axis=1)
    flat = np.clip(np.einsum("pik,pk->pi", planes[rows], where), 0.0, 1.0)
    weights = flat * inverse_depth[seen][rows]
    weights /= weights.sum(axis=1, keepdims=True)
    heights = 1.0 / np.maximum(np.hypot(planes[rows, :, 0], planes[rows, :, 1]), 1e-12)
    return Fragments(
        pixels=pixels,
        triangles=seen[rows],
        weights=weights,
        edge_px=(flat * heights).min(axis=1).astype(np.float32),
        height_px=heights.min(axis=1).astype(np.float32),
    )


def _cover(
    rows: NDArray[np.int64],
    grid: Floats,
    planes: Floats,
    nearness: Floats,
    low: Doubles,
    size: tuple[int, int],
    nearest: NDArray[np.uint64],
) -> None:
    """Enter the pixels of triangles `rows`, whose boxes all fit `grid`, into the z-buffer `nearest`."""
    width, height = size
    inside = planes[rows, 0] @ grid >= -_EDGE
    inside &= planes[rows, 1] @ grid >= -_EDGE
    inside &= planes[rows, 2] @ grid >= -_EDGE
    triangle, cell = np.nonzero(inside)
    row = rows[triangle]
    x = low[row, 0].astype(np.int64) + grid[0, cell].astype(np.int64)
    y = low[row, 1].astype(np.int64) + grid[1, cell].astype(np.int64)
    on_picture = (x < width) & (y < height)
    row, cell, x, y = row[on_picture], cell[on_picture], x[on_picture], y[on_picture]
    # The bits of a positive float order as the float does: complemented, the smallest key is the nearest.
    inverse = np.maximum(np.einsum("pk,kp->p", nearness[row], grid[:, cell]), np.float32(0))
    keys = (~inverse.view(np.uint32)).astype(np.uint64) << np.uint64(32) | row.astype(np.uint64)
    np.minimum.at(nearest, y * width + x, keys)
