"""The connected parts of a mesh, and how it is cut for xatlas and put together again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.types import Doubles, Ints

Indices = NDArray[np.integer]


def parts(faces: Indices, count: int) -> Indices:
    """(M,): the connected part of each face, numbered from 0; faces that share a vertex are connected.

    Every vertex takes the lowest label around it until nothing changes, with the labels' own labels taken on the way
    (pointer jumping), which needs about five rounds: quicker than to import a library for graphs.
    """
    label = np.arange(count)
    corners = tuple(np.ascontiguousarray(column) for column in faces.T)
    while True:
        lowest = np.minimum(np.minimum(label[corners[0]], label[corners[1]]), label[corners[2]])
        new = label.copy()
        for corner in corners:
            np.minimum.at(new, label[corner], lowest)
        while True:
            jumped = new[new]
            if np.array_equal(jumped, new):
                break
            new = jumped
        if np.array_equal(new, label):
            break
        label = new
    used = np.zeros(count, bool)
    used[label[corners[0]]] = True
    return np.asarray((np.cumsum(used) - 1)[label[corners[0]]])


def tiles(part: Indices, centres: Doubles, limit: int) -> list[Indices]:
    """Cut a mesh for xatlas, whose time grows faster than the size of a piece.

    Args:
        part: (M,) the connected part of each face.
        centres: (M, 2) of the faces on the view, px.
        limit: faces that a tile has at most.

    Returns:
        The faces of each tile, the largest tile first. Small parts share a tile whole; a large one is cut across its
        longer side into tiles of one size.
    """
    order = np.argsort(part, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(part[order])) + 1)
    cut: list[Indices] = []
    together: list[Indices] = []
    for group in sorted(groups, key=len):
        if len(group) > limit:
            cut += _halves(group, centres, -(-len(group) // limit))
            continue
        if sum(map(len, together)) + len(group) > limit:
            cut.append(np.concatenate(together))
            together = []
        together.append(group)
    if together:
        cut.append(np.concatenate(together))
    return sorted(cut, key=len, reverse=True)


def _halves(faces: Indices, centres: Doubles, count: int) -> list[Indices]:
    if count == 1:
        return [faces]
    axis = int(np.ptp(centres[faces], axis=0).argmax())
    middle = len(faces) * (count // 2) // count
    faces = faces[np.argpartition(centres[faces, axis], middle)]
    return _halves(faces[:middle], centres, count // 2) + _halves(faces[middle:], centres, count - count // 2)


def join_small(chart: Indices, faces: Ints, seen: Doubles, area: Doubles, smallest: float) -> Indices:
    """Give charts that are too small to be worth a gutter to the neighbour that they share the longest border with.

    Args:
        chart: (M,) the chart of each face, from 0.
        faces: (M, 3).
        seen: (N, 2) the vertices on the view, px.
        area: (M,) of the faces on the view, px.
        smallest: area that a chart keeps to itself from, px.

    Returns:
        (M,) the chart of each face, with gaps in the numbers. A chart without neighbours stays.
    """
    lowest, highest = np.full(len(seen), len(faces)), np.full(len(seen), -1)
    np.minimum.at(lowest, faces, chart[:, None])
    np.maximum.at(highest, faces, chart[:, None])
    border = np.flatnonzero((lowest < highest)[faces].any(axis=1))
    a, b, c = faces[border].T.astype(np.int64)
    # Sides, and each corner as a side without a length: what hangs by a corner alone has that one neighbour.
    starts, ends = np.concatenate([a, b, c, a, b, c]), np.concatenate([b, c, a, a, b, c])
    key = np.minimum(starts, ends) * len(seen) + np.maximum(starts, ends)
    order = np.argsort(key)
    one, other = border[order[:-1] % len(border)], border[order[1:] % len(border)]
    meets = (key[order[1:]] == key[order[:-1]]) & (chart[one] != chart[other])
    one, other, side = one[meets], other[meets], order[1:][meets]
    # Whole numbers add up to the same from either side, so that no circle of charts can choose each other in turn.
    length = np.rint(256 * np.linalg.norm(seen[starts[side]] - seen[ends[side]], axis=1))
    one, other, length = np.concatenate([one, other]), np.concatenate([other, one]), np.tile(length, 2)
    chart = np.array(chart)
    while True:
        a, b = chart[one], chart[other]
        size = np.bincount(chart, area)
        leaving = (a != b) & (size[a] < smallest)
        if not leaving.any():
            return chart
        pairs, which = np.unique(a[leaving].astype(np.int64) * len(size) + b[leaving], return_inverse=True)
        shared = np.bincount(which, length[leaving])
        a, b = np.divmod(pairs, len(size))
        ranked = np.lexsort([b, shared, a])
        longest = ranked[np.append(np.flatnonzero(np.diff(a[ranked])), len(ranked) - 1)]
        into = np.arange(len(size))
        into[a[longest]] = b[longest]
        # Where two choose each other, the lower number stays.
        mutual = (into[into] == np.arange(len(size))) & (into > np.arange(len(size)))
        into[mutual] = np.flatnonzero(mutual)
        for _ in range(len(size).bit_length()):
            into = into[into]
        chart = into[chart]
