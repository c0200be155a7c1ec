"""Smooth a surface without shrinking it."""

from __future__ import annotations

import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.types import Doubles, Ints, Surface

# Putting a vertex back can turn a neighbouring triangle; that dies out after two or three rounds.
_ROUNDS = 5


def fair(
    surface: Surface,
    *,
    iterations: int = 10,
    forward: float = 0.5,
    pass_band: float = 0.1,
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Surface:
    """Take the roughness off a mesh with Taubin's filter, which keeps its size.

    Each iteration moves every vertex towards the mean of its neighbours by `forward` and then away from it by a
    little more, `backward` = 1 / (1 / forward - pass_band) (G. Taubin, "A Signal Processing Approach to Fair
    Surface Design", SIGGRAPH 1995, section 4). Waves of the surface below the pass band keep their height, the
    shorter ones die out. A vertex on a border has only its neighbours along the border, so that borders get
    smooth but are not drawn inwards; a vertex where more than two border edges meet stays. So does, in the end,
    one whose move would turn a triangle's back to the camera.

    Args:
        surface: the mesh; each edge with one triangle is a border.
        iterations: how many times; 0 returns the surface as it is.
        forward: share of the way to the neighbours' mean, above 0 and below 1 (Taubin's lambda).
        pass_band: frequency that the filter leaves as it is, above 0 (Taubin's k_PB; 0.01 to 0.1 there).
        centre: where the reference view's camera stands: (baseline, 0, 0) for the right view.

    Returns:
        Surface with the same faces and moved vertices.

    Raises:
        InputError: an option is out of range.
    """
    if iterations < 0:
        raise InputError(f"iterations is {iterations}: pass 0 or more")
    if not (0 < forward < 1 and 0 < pass_band < 1 / forward - 1):
        # The bound keeps backward under 1, past which the second step throws vertices beyond their mirror image.
        raise InputError(
            f"forward {forward} and pass_band {pass_band} do not make a stable filter: pass 0.5 and 0.1, or"
            " 0 < forward < 1 with 0 < pass_band < 1 / forward - 1"
        )
    if iterations == 0 or not len(surface.faces):
        return surface
    backward = 1 / (1 / forward - pass_band)
    start, end = _neighbours(surface.faces, len(surface.vertices))
    # The origin is moved to the middle, so that sums of neighbours far from the camera lose no digits.
    middle = surface.vertices.mean(axis=0, dtype=np.float64)
    vertices = surface.vertices - middle
    for _ in range(iterations):
        vertices += forward * _to_mean(vertices, start, end)
        vertices -= backward * _to_mean(vertices, start, end)
    before = surface.vertices - middle
    eye = np.asarray(centre, np.float64) - middle
    facing = _towards(before, surface.faces, eye) > 0
    for _ in range(_ROUNDS):
        over = facing & (_towards(vertices, surface.faces, eye) <= 0)
        if not over.any():
            break
        back = np.unique(surface.faces[over])
        vertices[back] = before[back]
    return Surface(vertices=(vertices + middle).astype(np.float32), faces=surface.faces)


def _towards(vertices: Doubles, faces: Ints, eye: Doubles) -> Doubles:
    """(M,): above 0 for a face whose front is turned to the eye."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return np.asarray(np.einsum("ij,ij->i", np.cross(b - a, c - a), eye - a))


def _neighbours(faces: Ints, count: int) -> tuple[Ints, Ints]:
    """(E,), (E,): for each vertex that may move, itself and a vertex that pulls it, sorted by the first."""
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    # One number an edge: sorting these is ten times faster than np.unique over rows.
    edge, shared = np.unique(sides[:, 0].astype(np.int64) * count + sides[:, 1], return_counts=True)
    a, b = edge // count, edge % count
    on_border = shared == 1
    degree = np.bincount(np.concatenate([a[on_border], b[on_border]]), minlength=count)
    start, end = np.concatenate([a, b]), np.concatenate([b, a])
    along = np.concatenate([on_border, on_border])
    # Inside, every edge pulls; on a border only the border's own, and where pieces meet in a point, none.
    pulls = (degree[start] == 0) | ((degree[start] == 2) & along)
    start, end = start[pulls], end[pulls]
    order = np.argsort(start, kind="stable")
    return start[order].astype(np.int32), end[order].astype(np.int32)


def _to_mean(vertices: Doubles, start: Ints, end: Ints) -> Doubles:
    """(N, 3): the way from each vertex to the mean of its neighbours; 0 where nothing pulls."""
    count = np.maximum(np.bincount(start, minlength=len(vertices)), 1)
    sums = [np.bincount(start, vertices[end, i] - vertices[start, i], len(vertices)) for i in range(3)]
    return np.stack(sums, axis=1) / count[:, None]
