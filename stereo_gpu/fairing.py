"""Smooth a surface along the lines of sight, where its noise is, and keep its edges and its size."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.errors import InputError
from stereo_gpu.meshing.outline import smooth_outline
from stereo_gpu.meshing.view_frame import ViewFrame
from stereo_gpu.types import Doubles, Ints, Surface

# Taubin's lambda: the share of the way to what the neighbours expect.
_FORWARD = 0.5
# Of two vertices, each on a plane of its own, one is off the other's plane by about so many times its noise.
_PLANE_NOISE = 2.0
# Spread of the neighbours that counts as none, against their distance: past it a row of neighbours gives no slope.
_RIDGE = 0.01


def fair(
    surface: Surface,
    frame: ViewFrame,
    *,
    iterations: int = 10,
    pass_band: float = 0.15,
    noise_px: float = 0.07,
    furthest_px: float = 0.25,
    outline_px: float = 0.5,
) -> Surface:
    """Take the noise of the disparities off a mesh.

    What a stereo camera gets wrong is a point's disparity: the noise lies along the line of sight and is the same
    everywhere in disparity, Z^2 / (focal length x baseline) times that in depth. So vertices move along their lines of
    sight, and are smoothed in disparity over the picture, where planes are planes still. No triangle can turn over,
    and the picture stays where it is on the surface.

    Each pass moves a vertex towards what its neighbours expect, the plane through them at its place, and then away
    from that by a little more, so that waves below the pass band keep their height and nothing shrinks (G. Taubin, "A
    Signal Processing Approach to Fair Surface Design", SIGGRAPH 1995, section 4). A neighbour counts less the farther
    both vertices lie off each other's plane, against the noise: creases and steps stay (after T. Jones, F. Durand and
    M. Desbrun, "Non-Iterative, Feature-Preserving Mesh Smoothing", SIGGRAPH 2003). A plane instead of the mean lets
    slopes run up to such edges and to borders unchanged. Borders are then smoothed along themselves in the picture.

    Args:
        surface: the mesh, every vertex before the camera; each edge with one triangle is a border.
        frame: of the view that the surface lies before.
        iterations: passes; 0 returns the surface as it is.
        pass_band: frequency that the filter leaves as it is, above 0 and below 1 (Taubin's k_PB; 0.01 to 0.1 there).
        noise_px: standard deviation of a vertex's disparity; what differs by several times that is an edge.
        furthest_px: no vertex moves by more than this in disparity, so that no detail is lost in a coarse mesh.
        outline_px: how far a vertex of the border may move in the picture; 0 keeps borders as they are.

    Returns:
        Surface with the same faces and moved vertices.

    Raises:
        InputError: an option is out of range.
        StageError: a vertex lies behind the camera.
    """
    if iterations < 0:
        raise InputError(f"iterations is {iterations}: pass 0 or more")
    if not 0 < pass_band < 1:
        raise InputError(f"pass_band is {pass_band}: pass a number above 0 and below 1, such as 0.15")
    if not (noise_px > 0 and furthest_px >= 0 and outline_px >= 0):
        raise InputError(
            f"noise_px {noise_px}, furthest_px {furthest_px} and outline_px {outline_px} are not all usable: pass a"
            " noise above 0, the others 0 or more"
        )
    if iterations == 0 or not len(surface.faces):
        return surface
    corners = frame.see(surface.vertices)
    edges, shared = find_edges(surface.faces, len(corners))
    weights, slopes = _weigh(corners, edges, noise_px)
    mean, tilt = _expectation(corners, weights, slopes)
    disparity = corners[:, 2].copy()
    backward = 1 / (1 / _FORWARD - pass_band)
    for _ in range(iterations):
        disparity += _FORWARD * (mean @ disparity + tilt - disparity)
        disparity -= backward * (mean @ disparity + tilt - disparity)
    smooth = corners.copy()
    smooth[:, 2] = np.clip(disparity, corners[:, 2] - furthest_px, corners[:, 2] + furthest_px)
    if outline_px > 0:
        places = smooth_outline(corners[:, :2], surface.faces, edges[shared == 1], iterations, pass_band, outline_px)
        smooth[:, 2] += ((places - corners[:, :2]) * slopes).sum(axis=1)
        smooth[:, :2] = places
    return Surface(vertices=frame.place(smooth), faces=surface.faces)


def find_edges(faces: Ints, count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Edges of a mesh of `count` vertices: (E, 2) vertices, the lower one first, and (E,) how many faces share each."""
    a, b, c = faces.T.astype(np.int64)
    start, end = np.concatenate([a, b, c]), np.concatenate([b, c, a])
    # One number an edge: sorting these is ten times faster than np.unique over rows.
    key = np.sort(np.minimum(start, end) * count + np.maximum(start, end))
    first = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]]))
    shared = np.diff(np.append(first, len(key)))
    return np.stack(np.divmod(key[first], count), axis=1), shared


def _weigh(corners: Doubles, edges: NDArray[np.int64], noise_px: float) -> tuple[Any, Doubles]:
    """How much neighbours count for each other, (N, N) sparse; and the slope at each vertex, (N, 2) px a px."""
    x, y, d = corners.T
    weights, edge_of = _matrix(edges, len(corners))
    count, mx, my, xx, xy, yy = _moments(weights, corners, own=1.0)
    products = np.column_stack([d, x * d, y * d])
    md, xd, yd = ((weights @ products + products) / count[:, None]).T
    xd, yd = xd - mx * md, yd - my * md
    determinant = xx * yy - xy * xy
    slope_x, slope_y = (yy * xd - xy * yd) / determinant, (xx * yd - xy * xd) / determinant
    a, b = edges.T
    across, down, step = x[b] - x[a], y[b] - y[a], d[b] - d[a]
    off = (step - slope_x[a] * across - slope_y[a] * down) ** 2 + (step - slope_x[b] * across - slope_y[b] * down) ** 2
    # The mean of both squares, as a Gaussian; never quite 0, so that each vertex keeps some neighbours.
    alike = np.exp(-off / (4 * (_PLANE_NOISE * noise_px) ** 2)) + 1e-9
    weights.data = alike[edge_of]
    return weights, np.stack([slope_x, slope_y], axis=1)


def _expectation(corners: Doubles, weights: Any, slopes: Doubles) -> tuple[Any, Doubles]:
    """What neighbours expect of a vertex, the plane fitted to their values v at its place: matrix @ v + tilt.

    The matrix is (N, N) sparse. Where neighbours lie in a row, the plane leans across it by `slopes`, (N, 2).
    """
    x, y = corners[:, 0], corners[:, 1]
    total, mx, my, xx, xy, yy = _moments(weights, corners)
    far = (xx + (mx - x) ** 2 + yy + (my - y) ** 2) * _RIDGE
    xx, yy = xx + far, yy + far
    determinant = xx * yy - xy * xy
    away_x, away_y = x - mx, y - my
    across = (yy * away_x - xy * away_y) / determinant
    down = (xx * away_y - xy * away_x) / determinant
    result = weights.copy()
    count, column = np.diff(weights.indptr), weights.indices
    level = (1 - across * mx - down * my) / total
    share = np.repeat(level, count)
    share += np.repeat(across / total, count) * x[column]
    share += np.repeat(down / total, count) * y[column]
    result.data = weights.data * share
    return result, slopes[:, 0] * (x - result @ x) + slopes[:, 1] * (y - result @ y)


def _moments(weights: Any, corners: Doubles, own: float = 0.0) -> tuple[Doubles, ...]:
    """Of each vertex's neighbours in the picture: sum of weights, mean place, and spread about it; `own` is its own."""
    x, y = corners[:, 0], corners[:, 1]
    terms = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    sums = weights @ terms + own * terms
    total = np.maximum(sums[:, 0], 1e-30)
    mx, my, xx, xy, yy = (sums[:, 1:] / total[:, None]).T
    # Never quite without a spread, which all three in a line would be.
    return total, mx, my, xx - mx * mx + 1e-6, xy - mx * my, yy - my * my + 1e-6


def _matrix(edges: NDArray[np.int64], count: int) -> tuple[Any, NDArray[np.int64]]:
    """A symmetric (N, N) sparse matrix with a 1 for each edge, twice; and the edge that each entry belongs to."""
    from scipy.sparse import coo_array

    a, b = edges.astype(np.int32).T
    number = np.arange(len(edges))
    both = np.concatenate([a, b]), np.concatenate([b, a])
    matrix = coo_array((np.concatenate([number, number]), both), shape=(count, count)).tocsr()
    edge_of = matrix.data
    matrix.data = np.ones(len(edge_of))
    return matrix, edge_of
