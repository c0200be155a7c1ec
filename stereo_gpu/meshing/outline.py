"""Smooth the borders of a mesh along themselves, in the picture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.types import Doubles, Ints

_FORWARD = 0.5  # Taubin's lambda
# Putting a vertex back can turn a neighbouring triangle; that dies out after two or three rounds.
_ROUNDS = 5


def smooth_outline(
    places: Doubles, faces: Ints, border: NDArray[np.int64], iterations: int, pass_band: float, furthest_px: float
) -> Doubles:
    """Take the steps of the pixels off the outline of a mesh, and leave its corners.

    Taubin's filter, as in `fairing.fair`, along each chain of border edges. A vertex takes part the less the farther
    it lies off the line between its neighbours to begin with: a step of pixels is off by half a pixel, a corner by
    more. One at which more than two border edges meet stays, and so does one whose move would turn a triangle over.

    Args:
        places: (N, 2), column and row of each vertex, px.
        faces: (M, 3), counter-clockwise on the picture (y down).
        border: (B, 2), the edges with one face.
        iterations, pass_band: of the filter.
        furthest_px: no vertex moves farther than this in a column or row.

    Returns:
        (N, 2), the new places.
    """
    degree = np.bincount(border.ravel(), minlength=len(places))
    start, end = np.concatenate([border, border[:, ::-1]]).T
    chain = degree[start] == 2
    start, end = start[chain], end[chain]
    order = np.argsort(start, kind="stable")
    moving, pulls = start[order][::2], end[order].reshape(-1, 2)
    # The nearer neighbour pulls more: where a short edge meets a long one, the line between both is still straight.
    apart = np.linalg.norm(places[pulls] - places[moving][:, None], axis=2) + 1e-9
    share = apart[:, ::-1] / apart.sum(axis=1, keepdims=True)

    def to_line(now: Doubles) -> Doubles:
        return np.asarray((share[..., None] * now[pulls]).sum(axis=1) - now[moving])

    off = (to_line(places) ** 2).sum(axis=1, keepdims=True)
    part = np.exp(-off / (2 * max(furthest_px, 1e-9) ** 2))
    now = places.copy()
    backward = 1 / (1 / _FORWARD - pass_band)
    for _ in range(iterations):
        now[moving] += _FORWARD * part * to_line(now)
        now[moving] -= backward * part * to_line(now)
    now = np.clip(now, places - furthest_px, places + furthest_px)
    moved = (now[:, 0] != places[:, 0]) | (now[:, 1] != places[:, 1])
    touched = faces[moved[faces[:, 0]] | moved[faces[:, 1]] | moved[faces[:, 2]]]
    for _ in range(_ROUNDS):
        over = signed_areas(now, touched) <= 0.1 * np.maximum(signed_areas(places, touched), 0)
        over &= (now[touched] != places[touched]).any(axis=(1, 2))
        if not over.any():
            break
        back = np.unique(touched[over])
        now[back] = places[back]
    return now


def signed_areas(places: Doubles, faces: NDArray[np.integer]) -> Doubles:
    """(M,): area of each triangle on the picture, above 0 for counter-clockwise with y down."""
    a, b, c = (places[faces[:, i], :2] for i in range(3))
    p, q = b - a, c - a
    return np.asarray(0.5 * (p[:, 1] * q[:, 0] - p[:, 0] * q[:, 1]))
