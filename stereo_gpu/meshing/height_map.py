"""The height of a triangle mesh over the pixels of a picture, by scan conversion."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.types import Doubles, Ints

_EDGE = 1e-3  # px: a pixel on an edge belongs to the triangle, and vertices are float32


def height_map(corners: Doubles, faces: Ints, size: tuple[int, int]) -> Doubles:
    """Interpolate the third coordinate at every pixel's centre.

    Args:
        corners: (N, 3), column, row and height; pixel centres at whole numbers.
        faces: (M, 3), none over another; where they are, one of them counts.
        size: (width, height) of the picture, px.

    Returns:
        (height, width) float64, NaN where there is no triangle.
    """
    return height_and_owner(corners, faces, size)[0]


def height_and_owner(corners: Doubles, faces: Ints, size: tuple[int, int]) -> tuple[Doubles, NDArray[np.int64]]:
    """`height_map`, and which face it was taken from, (height, width); -1 where there is none."""
    width, height = size
    a, b, c = (corners[faces[:, i]] for i in range(3))
    p, q = b - a, c - a
    area = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    solid = np.abs(area) > _EDGE**2
    a, b, c, p, q, area = (part[solid] for part in (a, b, c, p, q, area))
    slope_x = (p[:, 2] * q[:, 1] - q[:, 2] * p[:, 1]) / area
    slope_y = (q[:, 2] * p[:, 0] - p[:, 2] * q[:, 0]) / area
    # Every row that a triangle reaches, then every pixel between its left and its right edge there.
    top = np.maximum(np.ceil(np.minimum(np.minimum(a[:, 1], b[:, 1]), c[:, 1]) - _EDGE), 0)
    bottom = np.minimum(np.floor(np.maximum(np.maximum(a[:, 1], b[:, 1]), c[:, 1]) + _EDGE), height - 1)
    triangle, y = _runs(top, bottom)
    left, right = np.full(len(y), np.inf), np.full(len(y), -np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        x0, y0 = start[:, 0], start[:, 1]
        x1, y1 = end[:, 0], end[:, 1]
        level = y0 == y1
        slant = np.where(level, 0.0, (x1 - x0) / np.where(level, 1.0, y1 - y0))
        upper, lower = np.minimum(y0, y1), np.maximum(y0, y1)
        at = x0[triangle] + (np.clip(y, upper[triangle], lower[triangle]) - y0[triangle]) * slant[triangle]
        reached = (y >= upper[triangle] - _EDGE) & (y <= lower[triangle] + _EDGE)
        # The ends of a level edge belong to the two others as well.
        reached &= ~level[triangle]
        left = np.where(reached, np.minimum(left, at), left)
        right = np.where(reached, np.maximum(right, at), right)
    row, x = _runs(np.maximum(np.ceil(left - _EDGE), 0), np.minimum(np.floor(right + _EDGE), width - 1))
    triangle, y = triangle[row], y[row]
    place = y.astype(np.int64) * width + x.astype(np.int64)
    heights, owner = np.full(height * width, np.nan), np.full(height * width, -1)
    owner[place] = np.flatnonzero(solid)[triangle]
    base = a[:, 2] - slope_x * a[:, 0] - slope_y * a[:, 1]
    heights[place] = base[triangle] + slope_x[triangle] * x + slope_y[triangle] * y
    return heights.reshape(height, width), owner.reshape(height, width)


def _runs(first: Doubles, last: Doubles) -> tuple[NDArray[np.int64], Doubles]:
    """For each range of whole numbers its index, and for each of its numbers the number, one after another."""
    length = np.maximum(last - first + 1, 0)
    length = np.where(np.isfinite(length), length, 0).astype(np.int64)
    index = np.repeat(np.arange(len(length)), length)
    before = np.cumsum(length) - length
    return index, np.arange(len(index)) - before[index] + first[index]
