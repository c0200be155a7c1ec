"""How far two surfaces that one view sees are from each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.meshing.height_map import height_and_owner
from stereo_gpu.meshing.view_frame import ViewFrame
from stereo_gpu.types import Doubles, Ints

_REACH = 2  # px around a place in which the nearest triangle of the other surface is looked for
_STEPS = sorted(
    ((x, y) for x in range(-_REACH, _REACH + 1) for y in range(-_REACH, _REACH + 1)),
    key=lambda s: s[0] ** 2 + s[1] ** 2,
)


def compare(
    one: tuple[Doubles, Ints], other: tuple[Doubles, Ints], frame: ViewFrame, *, enough: float = 0.0
) -> tuple[float, Doubles]:
    """The distance in space from what the view sees of either surface to the other one, at most.

    Both are sampled once a pixel, where the first one's vertices lie if these are pixels. A sample's distance is that
    to the nearest of the triangles that the view sees within 2 px of it: the true distance is at most that.

    Args:
        one, other: corners (N, 3) in columns, rows and disparity of the frame, px, and faces (M, 3).
        frame: of the view.
        enough: a sample for which this is not passed is looked at no further, which saves time; the result is exact
            where it is larger.

    Returns:
        The largest distance, in the frame's unit, infinite if a part of either has nothing of the other near it; where
        it is larger than `enough`, (P, 2) columns and rows.
    """
    low = np.minimum(one[0][:, :2].min(axis=0), other[0][:, :2].min(axis=0))
    high = np.maximum(one[0][:, :2].max(axis=0), other[0][:, :2].max(axis=0))
    phase = one[0][0, :2] % 1
    start = np.floor(low - phase) + phase - _REACH
    columns, rows = (np.ceil(high - start) + 1 + _REACH).astype(int)
    shift = np.append(start, 0.0)
    points, owners, triangles = [], [], []
    for corners, faces in (one, other):
        heights, owner = height_and_owner(corners - shift, faces, (columns, rows))
        y, x = np.nonzero(owner >= 0)
        points.append(frame.place(np.column_stack([x + start[0], y + start[1], heights[y, x]])).astype(np.float64))
        owners.append(owner)
        triangles.append(frame.place(corners).astype(np.float64)[faces])
    far, where = 0.0, []
    for i in (0, 1):
        places = np.flatnonzero(owners[i] >= 0)
        apart = _nearest(points[i], places, owners[1 - i], triangles[1 - i], enough)
        y, x = np.divmod(places[apart > enough], columns)
        where.append(np.column_stack([x, y]) + start)
        far = max(far, float(apart.max(initial=0.0)))
    return far, np.concatenate(where)


def _nearest(
    points: Doubles, places: NDArray[np.int64], owner: NDArray[np.int64], triangles: Doubles, enough: float
) -> Doubles:
    """(P,): distances from points to the nearest of the triangles that are seen around their places."""
    nearest, left = np.full(len(points), np.inf), np.arange(len(points))
    for step_x, step_y in _STEPS:
        beside = owner.ravel()[places[left] + step_y * owner.shape[1] + step_x]
        there = beside >= 0
        found = left[there]
        nearest[found] = np.minimum(nearest[found], distances(points[found], triangles[beside[there]]))
        left = left[nearest[left] > enough]
        if not len(left):
            break
    return nearest


def distances(points: Doubles, triangles: Doubles) -> Doubles:
    """(N,): from points (N, 3) to one triangle each (N, 3, 3)."""
    a, p, q = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    off = points - a
    pp, pq, qq = _dot(p, p), _dot(p, q), _dot(q, q)
    op, oq = _dot(off, p), _dot(off, q)
    area = np.maximum(pp * qq - pq * pq, 1e-300)
    s, t = (qq * op - pq * oq) / area, (pp * oq - pq * op) / area
    square = _dot(*(off - s[:, None] * p - t[:, None] * q,) * 2)
    outside = np.flatnonzero((s < 0) | (t < 0) | (s + t > 1))
    sides = [_to_segment(points[outside], triangles[outside, i], triangles[outside, (i + 1) % 3]) for i in range(3)]
    square[outside] = np.minimum(np.minimum(sides[0], sides[1]), sides[2])
    return np.asarray(np.sqrt(square))


def _to_segment(points: Doubles, start: Doubles, end: Doubles) -> Doubles:
    along, off = end - start, points - start
    share = np.clip(_dot(off, along) / np.maximum(_dot(along, along), 1e-300), 0, 1)
    return _dot(*(off - share[:, None] * along,) * 2)


def _dot(a: Doubles, b: Doubles) -> Doubles:
    return np.asarray((a * b).sum(axis=1))
