"""From a disparity map to triangles: the Delaunay mesh of the pixel lattice, cut where depth jumps."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_gpu.errors import InputError, StageError
from stereo_gpu.types import Doubles, Floats, Ints, Surface

_Mask = NDArray[np.bool_]


def build_mesh(
    values: Floats,
    points: Floats,
    *,
    max_jump_px: float = 1.5,
    min_angle_deg: float = 5.0,
    min_faces: int = 300,
    farthest: float = 10.0,
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Surface:
    """Join neighbouring pixels into triangles wherever they show the same surface.

    Four neighbouring pixels lie on one circle, so either diagonal of their square is Delaunay: the one with
    the smaller step in disparity is taken, which lets edges of objects run between triangles. Where only
    three of the four have a value, they make one triangle.

    Args:
        values: (H, W) float32 disparity, px; NaN where there is none.
        points: (H, W, 3) float32, the point that each pixel shows; NaN where there is none.
        max_jump_px: no triangle whose corners differ by more than this in disparity.
        min_angle_deg: no triangle that is seen at a flatter angle than this; such are drawn out between
            two objects, not seen on one.
        min_faces: no connected piece with fewer triangles than this.
        farthest: no point beyond so many times the median depth, nor one at or behind the camera: tiny
            disparities give depths without meaning, and one such vertex spoils everything that scales a mesh
            by its size.
        centre: where the reference view's camera stands, in the frame of `points`: (baseline, 0, 0) for
            the right view.

    Returns:
        Surface with the vertices in use only, in row order, and faces counter-clockwise seen from the cameras.

    Raises:
        InputError: the two arrays do not fit, or an option is out of range.
        StageError: no triangle is left.
    """
    _check(values, points, max_jump_px, min_angle_deg, farthest)
    usable = _usable(values, points, farthest)
    faces = _lattice(values, usable, max_jump_px)
    flat = points.reshape(-1, 3)
    faces = faces[_seen_openly(flat, faces, min_angle_deg, centre)]
    faces = faces[_piece_size(faces, values.shape) >= min_faces]
    if not len(faces):
        raise StageError(
            f"no mesh: of {values.size} pixels {int(usable.sum())} have a usable disparity and none make a piece"
            f" of {min_faces} triangles; widen the disparity range or lower min_faces"
        )
    return compact(flat, faces)


def compact(vertices: Floats | Doubles, faces: NDArray[np.integer]) -> Surface:
    """Drop the vertices that no face uses and renumber the rest, order kept."""
    used = np.zeros(len(vertices), bool)
    used[faces.ravel()] = True
    number = np.cumsum(used, dtype=np.int32) - 1
    return Surface(
        vertices=np.ascontiguousarray(vertices[used], np.float32),
        faces=np.ascontiguousarray(number[faces], np.int32),
    )


def _check(values: Floats, points: Floats, max_jump_px: float, min_angle_deg: float, farthest: float) -> None:
    if values.ndim != 2 or points.shape != (*values.shape, 3):
        raise InputError(
            f"disparity of shape {values.shape} and points of shape {points.shape} do not fit: pass (H, W) and"
            " (H, W, 3) of one size"
        )
    if not max_jump_px > 0:
        raise InputError(f"max_jump_px is {max_jump_px}: pass a number above 0")
    if not 0 <= min_angle_deg < 90:
        raise InputError(f"min_angle_deg is {min_angle_deg}: pass degrees from 0 to below 90")
    if not farthest >= 1:
        raise InputError(f"farthest is {farthest}: pass a multiple of the median depth, 1 or more")


def _usable(values: Floats, points: Floats, farthest: float) -> _Mask:
    """(H, W): pixels with a finite disparity and a finite point at a depth with meaning."""
    depth = points[..., 2]
    usable: _Mask = np.isfinite(values) & np.isfinite(points).all(axis=2) & (depth > 0)
    if not usable.any():
        raise StageError(
            f"no mesh: none of {values.size} pixels has a disparity with a point before the camera; widen the"
            " disparity range or the mask, or check the calibration"
        )
    limit = farthest * float(np.median(depth[usable]))
    return usable & (depth <= limit)


def _lattice(values: Floats, usable: _Mask, max_jump_px: float) -> Ints:
    """(M, 3) faces over flat pixel indices, cut at jumps; square by square in row order."""
    height, width = values.shape
    disparity = np.where(usable, values, np.float32(np.nan))
    number = np.arange(height * width, dtype=np.int32).reshape(height, width)

    # a b   A square's corners. Each of its four possible triangles is listed counter-clockwise as seen,
    # c d   from the corner at its right angle on. Comparisons with NaN are false: no value, no triangle.
    first, last = slice(None, -1), slice(1, None)
    corners = (first, first), (first, last), (last, first), (last, last)
    a, b, c, d = (disparity[corner] for corner in corners)
    ia, ib, ic, id_ = (number[corner] for corner in corners)
    with np.errstate(invalid="ignore"):
        ab, ac, bd, cd = (abs(p - q) <= max_jump_px for p, q in ((a, b), (a, c), (b, d), (c, d)))
        ad, bc = abs(a - d), abs(b - c)
        # A triangle that lacks its fourth corner is on the only diagonal that exists.
        falling = (ad <= bc) | np.isnan(bc)
        rising = ~falling
        ad_fits, bc_fits = ad <= max_jump_px, bc <= max_jump_px
    triangles = (
        (falling & ad_fits & ac & cd, (ic, id_, ia)),
        (falling & ad_fits & ab & bd, (ib, ia, id_)),
        (rising & bc_fits & ab & ac, (ia, ic, ib)),
        (rising & bc_fits & bd & cd, (id_, ib, ic)),
    )
    return np.concatenate([np.stack([i[keep] for i in index], axis=1) for keep, index in triangles])


def _seen_openly(points: Floats, faces: Ints, min_angle_deg: float, centre: tuple[float, float, float]) -> _Mask:
    """(M,): faces whose plane the line of sight meets at `min_angle_deg` or more, from the front."""
    a, b, c = (points[faces[:, i]] for i in range(3))
    # In the order of the columns, since a (M, 3) cross product in numpy costs four times as much.
    px, py, pz = (b - a).T
    qx, qy, qz = (c - a).T
    nx, ny, nz = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
    rx, ry, rz = (a - np.asarray(centre, np.float32)).T
    towards = -(nx * rx + ny * ry + nz * rz)
    across = np.sqrt((nx * nx + ny * ny + nz * nz) * (rx * rx + ry * ry + rz * rz))
    return np.asarray((towards > 0) & (towards >= math.sin(math.radians(min_angle_deg)) * across))


def _piece_size(faces: Ints, shape: tuple[int, ...]) -> Ints:
    """(M,): how many faces the connected piece of each face has.

    Every face has one upright and one level side, so its corners hang together by such sides alone. They are
    drawn between the pixels of a lattice of twice the size, and a picture's connected components are then the
    mesh's: much faster than a search through a graph.
    """
    height, width = shape
    drawn = np.zeros((2 * height - 1, 2 * width - 1), np.uint8)
    rows, columns = np.divmod(faces, np.int32(width))
    drawn[2 * rows, 2 * columns] = 1
    for i, j in ((0, 1), (1, 2), (2, 0)):
        row, column = rows[:, i] + rows[:, j], columns[:, i] + columns[:, j]
        straight = (row & 1) ^ (column & 1) == 1
        drawn[row[straight], column[straight]] = 1
    _, label = cv2.connectedComponents(drawn, connectivity=4, ltype=cv2.CV_32S)
    of_face = label[2 * rows[:, 0], 2 * columns[:, 0]]
    return np.bincount(of_face)[of_face].astype(np.int32) if len(faces) else np.zeros(0, np.int32)
