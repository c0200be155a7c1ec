"""Quadric edge collapse to a number of triangles, in a view's columns, rows and disparities, borders kept."""

from __future__ import annotations

import threading

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.meshing.outline import signed_areas
from stereo_gpu.meshing.turn_edges import next_side, turn_edges, twins
from stereo_gpu.meshing.view_frame import ViewFrame
from stereo_gpu.types import Doubles, Ints

_Flags = NDArray[np.bool_]

# fast_simplification keeps its mesh in global variables: one call at a time in a process.
_ONE_AT_A_TIME = threading.Lock()
# Collapses are done in rounds, each for what costs less than a threshold: this in the first one, px, ...
_FIRST_PX = 0.05
# ... growing with this power. At its default of 7 collapses are less well ordered, and borders stray twice as far.
_AGGRESSION = 5.0
# What a disparity counts against a pixel across: it is known to a tenth of a pixel, an outline to half of one. From 1
# to 4 triangles get rounder, and the surface nearer to the truth.
_RELIEF = np.array([1.0, 1.0, 4.0])
# How far below the surface walls end, px; up to how many of them in one point, and else the side of the squares each
# of which has one.
_DEEP_PX, _AT_ONE_POINT, _SQUARE_PX = 10_000.0, 1000, 64.0
# The number of border edges falls with about this power of the number of triangles.
_BORDER_POWER = 0.22
_TRIES = 5  # to come below the number of triangles
# Edges are turned where that moves the surface by less than this, px of disparity.
_TURN_PX = 0.25
# Triangles of less area are lines, px^2.
_LEAST_AREA = 1e-3


def collapse(
    corners: Doubles, faces: Ints, target_faces: int, frame: ViewFrame, *, fixed: _Flags | None = None
) -> tuple[Doubles, Ints]:
    """Collapse edges until no more than `target_faces` are left, turn some for rounder triangles, and drop bad ones.

    Args:
        corners: (N, 3), columns, rows and disparities, px.
        faces: (M, 3), counter-clockwise on the picture (y down).
        target_faces: how many to keep, beside fixed ones.
        frame: that the corners lie in.
        fixed: (M,) faces that stay as they are; the others fit them still.

    Returns:
        Corners, not all of them used, and faces. Each side of a face is shared by one other or by none.
    """
    if fixed is not None and fixed.any():
        kept, left = _collapse_loose(corners, faces[~fixed], target_faces, frame, _sides_of(faces[fixed], len(corners)))
        return _join(corners, faces[fixed], kept, left)
    return _collapse_loose(corners, faces, target_faces, frame, np.zeros(0, np.int64))


def _collapse_loose(
    corners: Doubles, faces: Ints, target_faces: int, frame: ViewFrame, seam: NDArray[np.int64]
) -> tuple[Doubles, Ints]:
    """`collapse` for faces none of which is fixed, but for their sides in `seam` (start times N plus end)."""
    if not len(faces):
        return corners, faces
    kept, left = _reduce(corners, faces, target_faces, seam, _BORDER_POWER)
    for _ in range(_TRIES):
        if len(left) <= target_faces or len(seam):
            break
        kept, left = _reduce(kept, left, target_faces, seam, 1.0)  # the border has lost less than was thought
    left = left[_single(kept, left)]
    space = frame.place(kept).astype(np.float64)
    left = turn_edges(kept, left, tolerance=_TURN_PX, space=space)
    return kept, left[signed_areas(kept, left) > _LEAST_AREA]


def _reduce(
    corners: Doubles, faces: Ints, target_faces: int, seam: NDArray[np.int64], border_power: float
) -> tuple[Doubles, Ints]:
    import fast_simplification

    measured = corners * _RELIEF
    low, high = measured.min(axis=0), measured.max(axis=0)
    # The first threshold, on the square of a distance, is 3^aggression / 10^9.
    size = _FIRST_PX * (1e9 / 3**_AGGRESSION) ** 0.5
    feet, walls = _walls(measured, faces, seam)
    target = target_faces + round(len(walls) * min(target_faces / len(faces), 1) ** border_power)
    if target >= len(faces) + len(walls):
        return corners, faces
    with _ONE_AT_A_TIME:
        kept, left = fast_simplification.simplify(
            (np.concatenate([measured, feet]) - low) / size,
            np.concatenate([faces, walls]),
            target_count=target,
            agg=_AGGRESSION,
            preserve_border=bool(len(seam)),
        )
    kept, left = np.asarray(kept) * size + low, np.asarray(left, np.int32)
    # Whatever hangs on a point below is a wall.
    of_walls = kept[:, 2] < low[2] - _DEEP_PX / 2
    left = left[~of_walls[left].any(axis=1)]
    # A corner may be put where its planes meet, which for nearly parallel ones can be anywhere.
    return np.clip(kept, low, high) / _RELIEF, left


def _walls(corners: Doubles, faces: Ints, seam: NDArray[np.int64]) -> tuple[Doubles, Ints]:
    """Where walls end, (P, 3); and a triangle from each border edge to one of these, which go on from the corners.

    One point for all would do but for the library's time, which grows with the square of the triangles at a point.
    Where a border goes from one square to the next, its vertex is not moved; nor is it on the seam, which has no wall.
    """
    side = np.flatnonzero(twins(faces, len(corners)) < 0)
    start, end = faces.ravel()[side], faces.ravel()[next_side(side)]
    if len(seam):
        open_to_air = ~np.isin(end.astype(np.int64) * len(corners) + start, seam)
        start, end = start[open_to_air], end[open_to_air]
    square = np.floor(corners[start, :2] / (_SQUARE_PX if len(start) > _AT_ONE_POINT else np.inf)).astype(np.int64)
    square -= square.min(axis=0, initial=0)
    _, first, group = np.unique(square[:, 0] << 32 | square[:, 1], return_index=True, return_inverse=True)
    feet = corners[start[first]] - (0.0, 0.0, _DEEP_PX)
    return feet, np.stack([end, start, len(corners) + group], axis=1).astype(np.int32)


def _sides_of(faces: Ints, count: int) -> NDArray[np.int64]:
    return faces.astype(np.int64).ravel() * count + np.roll(faces, -1, axis=1).astype(np.int64).ravel()


def _single(corners: Doubles, faces: Ints) -> _Flags:
    """(M,): faces to keep so that no two run along one side in the same direction; the larger one stays."""
    key = _sides_of(faces, len(corners))
    order = np.lexsort((-np.repeat(signed_areas(corners, faces), 3), key))
    again = np.zeros(len(key), bool)
    again[order[1:]] = key[order[1:]] == key[order[:-1]]
    return np.asarray(~again.reshape(-1, 3).any(axis=1))


def _join(corners: Doubles, faces: Ints, others: Doubles, other_faces: Ints) -> tuple[Doubles, Ints]:
    """Two meshes as one; those of the others' corners that lie on one of the first mesh are that one."""
    every = np.concatenate([corners, others])
    places = np.rint(every * 1e4).astype(np.int64)
    order = np.lexsort(places.T)
    new = np.ones(len(order), bool)
    new[1:] = (places[order[1:]] != places[order[:-1]]).any(axis=1)
    # lexsort keeps the order of equal places, so that the first of a group is a corner of the first mesh, if any is.
    same = np.empty(len(order), np.int64)
    same[order] = order[new][np.cumsum(new) - 1]
    return every, same[np.concatenate([faces, other_faces + len(corners)])].astype(np.int32)
