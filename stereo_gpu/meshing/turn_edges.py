"""Turn the edges of a mesh so that its triangles get rounder, where that hardly moves the surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.types import Doubles, Ints

_Indices = NDArray[np.int64]
_Flags = NDArray[np.bool_]

# Each round turns a tenth of the edges that are left to turn; hardly any is left after this many.
_ROUNDS = 12
# Twice the area under which a triangle is a line, against the square of its longest side.
_FLAT = 1e-3
# An edge is turned for no less than this, lest rounding turns it to and fro.
_GAIN = 1e-6


def turn_edges(corners: Doubles, faces: Ints, *, tolerance: float, space: Doubles) -> Ints:
    """Exchange the diagonals of quadrangles until no smallest angle can be widened.

    An edge between two triangles is turned where the smallest of their angles in space gets wider by it, which on a
    plane is Delaunay's criterion (C. L. Lawson, "Software for C1 surface interpolation", 1977), and where the surface
    moves by no more than `tolerance` at the crossing of both diagonals, so that edges along a crease stay. Borders
    stay as they are. A triangle that lies upside down is put right in the same way, whatever the tolerance.

    Args:
        corners: (N, 3), columns and rows on the picture, and a height over it, all in one unit.
        faces: (M, 3), counter-clockwise on the picture (y down).
        tolerance: in that unit.
        space: (N, 3), the same corners in space, up to scale.

    Returns:
        (M, 3) int32, the faces in their order, some with other corners.
    """
    turned = faces.astype(np.int64)
    twin = twins(turned, len(corners))
    edges = np.flatnonzero(twin > np.arange(len(twin)))
    for _ in range(_ROUNDS):
        quads, gain = _better(corners, space, turned, twin, edges, tolerance)
        if not len(quads.edge):
            break
        # A triangle goes to the edge that gains most; an edge is turned that has both of its triangles.
        order = np.argsort(gain, kind="stable")
        first, second = quads.edge[order] // 3, twin[quads.edge[order]] // 3
        rank, best = np.arange(len(order)), np.full(len(turned), -1)
        np.maximum.at(best, first, rank)
        np.maximum.at(best, second, rank)
        chosen = order[(best[first] == rank) & (best[second] == rank)]
        changed = _turn(turned, twin, quads.take(chosen))
        # Next come the sides of the triangles that changed, and the edges that had to wait.
        near = np.concatenate([(3 * changed[:, None] + np.arange(3)).ravel(), quads.edge])
        near = near[twin[near] >= 0]
        edges = np.unique(np.minimum(near, twin[near]))
    return turned.astype(np.int32)


def twins(faces: NDArray[np.integer], count: int) -> _Indices:
    """(3 M,): for side 3 f + k, from corner k of face f to the next one, the same side of the neighbouring face.

    It is -1 on a border, and where more than two faces share a side or two faces run along it in one direction.
    """
    start = faces.astype(np.int64).ravel()
    end = np.roll(faces, -1, axis=1).astype(np.int64).ravel()
    key = np.minimum(start, end) * count + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    key = key[order]
    same = key[1:] == key[:-1]
    first = np.zeros(len(key), bool)
    first[:-1] = same
    first[1:] &= ~same  # neither the second of a pair
    first[:-2] &= key[2:] != key[:-2]  # nor the first of three
    i = np.flatnonzero(first)
    one, other = order[i], order[i + 1]
    opposite = start[one] == end[other]
    found = np.full(len(key), -1, np.int64)
    found[one[opposite]], found[other[opposite]] = other[opposite], one[opposite]
    return found


@dataclass(frozen=True)
class _Quads:
    """Edges a-b with the corners c and d across them, each (E,)."""

    edge: _Indices
    a: _Indices
    b: _Indices
    c: _Indices
    d: _Indices

    def take(self, which: _Indices | _Flags) -> _Quads:
        return _Quads(*(part[which] for part in (self.edge, self.a, self.b, self.c, self.d)))


def _better(
    corners: Doubles, space: Doubles, faces: _Indices, twin: _Indices, edges: _Indices, tolerance: float
) -> tuple[_Quads, Doubles]:
    """Which of these edges are better turned, and by how much the cosine of the smallest angle falls."""
    flat = faces.ravel()
    other = twin[edges]
    quads = _Quads(
        edges, flat[edges], flat[next_side(edges)], flat[next_side(next_side(edges))], flat[next_side(next_side(other))]
    )
    ax, ay, az = corners[quads.a].T
    bx, by, bz = corners[quads.b].T
    cx, cy, cz = corners[quads.c].T
    dx, dy, dz = corners[quads.d].T

    def area(px: Doubles, py: Doubles, qx: Doubles, qy: Doubles, rx: Doubles, ry: Doubles) -> Doubles:
        return np.asarray((rx - px) * (qy - py) - (qx - px) * (ry - py))  # above 0: counter-clockwise with y down

    abc, bad = area(ax, ay, bx, by, cx, cy), area(bx, by, ax, ay, dx, dy)
    adc, dbc = area(ax, ay, dx, dy, cx, cy), area(dx, dy, bx, by, cx, cy)
    upside_down = (abc <= 0) | (bad <= 0)
    whole, across = abc + bad, (cx - dx) ** 2 + (cy - dy) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        # where the diagonals cross: at share s of the way from a to b, and t of the way from c to d
        s, t = adc / whole, abc / whole
        moved = np.abs(az + (bz - az) * s - cz - (dz - cz) * t)
    gain = np.where(upside_down, np.inf, _wider(*(space[corner] for corner in (quads.a, quads.b, quads.c, quads.d))))
    good = (adc > _FLAT * across) & (dbc > _FLAT * across) & (upside_down | ((gain > _GAIN) & (moved <= tolerance)))
    return quads.take(good), gain[good]


def _wider(a: Doubles, b: Doubles, c: Doubles, d: Doubles) -> Doubles:
    """By how much the cosine of the smallest angle of triangles a b c and b a d is above that of a d c and d b c."""
    ab, ac, bc, ad, bd, cd = (
        np.einsum("ij,ij->i", q - p, q - p) for p, q in ((a, b), (a, c), (b, c), (a, d), (b, d), (c, d))
    )

    def sharpest(u: Doubles, v: Doubles, w: Doubles) -> Doubles:
        # The smallest angle is between the two longer sides.
        least = np.minimum(np.minimum(u, v), w)
        product = u * v * w / np.maximum(least, 1e-300)
        return np.asarray((u + v + w - 2 * least) / (2 * np.sqrt(np.maximum(product, 1e-300))))

    before = np.maximum(sharpest(ab, ac, bc), sharpest(ab, ad, bd))
    return np.asarray(before - np.maximum(sharpest(ad, cd, ac), sharpest(bd, bc, cd)))


def _turn(faces: _Indices, twin: _Indices, quads: _Quads) -> _Indices:
    """Turn edges that share no triangle, in place; returns the triangles that changed."""
    side, other = quads.edge, twin[quads.edge]
    first, second = side // 3, other // 3
    new = np.arange(len(twin))
    for old, place in (
        (next_side(other), 3 * first),
        (side, 3 * first + 1),
        (next_side(next_side(side)), 3 * first + 2),
        (next_side(next_side(other)), 3 * second),
        (next_side(side), 3 * second + 1),
        (other, 3 * second + 2),
    ):
        new[old] = place
    faces[first] = np.stack([quads.a, quads.d, quads.c], axis=1)
    faces[second] = np.stack([quads.d, quads.b, quads.c], axis=1)
    moved = np.full_like(twin, -1)
    moved[new] = np.where(twin >= 0, new[twin], -1)
    twin[:] = moved
    return np.concatenate([first, second])


def next_side(side: _Indices) -> _Indices:
    """The side after each one in its face."""
    return np.where(side % 3 == 2, side - 2, side + 1)
