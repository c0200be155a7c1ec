"""From a disparity map to triangles, cut where depth jumps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.backends import Backend, open_backend
from stereo_gpu.errors import InputError, StageError
from stereo_gpu.meshing.bounded_mesh import bounded_triangles
from stereo_gpu.meshing.cell_triangles import dense_triangles
from stereo_gpu.meshing.parts import covered_pixels, number_sheets
from stereo_gpu.meshing.sight import find_leaning, seen_openly
from stereo_gpu.types import Doubles, Floats, Ints, Surface

METHODS = ("bounded", "dense")

_Mask = NDArray[np.bool_]


def build_mesh(
    values: Floats,
    points: Floats,
    *,
    device: Backend | None = None,
    method: str = "bounded",
    error_px: float = 0.25,
    max_jump_px: float = 3.0,
    min_angle_deg: float = 5.0,
    smallest_part: float = 150,
    farthest: float = 10.0,
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0),
    infinity_px: float = 0.0,
) -> Surface:
    """Join pixels into triangles wherever they show the same surface.

    Args:
        values: (H, W) float32 disparity, px; NaN where there is none.
        points: (H, W, 3) float32, the point that each pixel shows; NaN where there is none.
        device: where errors and slopes are computed; None takes the best one.
        method: "bounded" (see `bounded_triangles`), or "dense": two triangles for every four neighbouring pixels.
        error_px: how far the bounded mesh may lie from the disparity of a pixel that it covers, px.
        max_jump_px: no triangle holds neighbouring pixels that differ by more than this in disparity.
        min_angle_deg: no triangle that is seen at a flatter angle than this; such are drawn out between two objects,
            not seen on one. Nor their flanks, see `seen_openly`; but of a map of whole pixels, which rises in steps.
        smallest_part: no part, of triangles that hang together by their sides, that covers fewer pixels than this.
        farthest: no point beyond so many times the median depth, nor one at or behind the camera: tiny
            disparities give depths without meaning, and one such vertex spoils everything that scales a mesh
            by its size.
        centre: where the reference view's camera stands, in the frame of `points`: (baseline, 0, 0) for
            the right view.
        infinity_px: disparity of a point at infinity, cx_left - cx_right.

    Returns:
        Surface with the vertices in use only, in row order, and faces counter-clockwise seen from the cameras.

    Raises:
        InputError: the two arrays do not fit, or an option is out of range.
        StageError: no triangle is left.
    """
    _check(values, points, method, error_px, max_jump_px, min_angle_deg, farthest)
    usable = _usable(values, points, farthest)
    known = np.where(usable, values, np.float32(np.nan))
    device = device or open_backend()
    settled = None
    if method == "dense":
        faces = dense_triangles(known, max_jump_px)
    else:
        faces, settled = bounded_triangles(
            device, known, error_px=error_px, max_jump_px=max_jump_px, infinity_px=infinity_px
        )
    flat = points.reshape(-1, 3)
    if settled is not None:
        flat = _moved(flat, faces, known.ravel(), settled.ravel(), centre, infinity_px)
    leaning = find_leaning(device, known) if (known[usable] % 1).any() else None
    faces = faces[seen_openly(flat, faces, values.shape, min_angle_deg, centre, leaning)]
    if len(faces):
        sheet, covered = number_sheets(faces, values.shape), covered_pixels(faces, values.shape)
        faces = faces[np.bincount(sheet, covered)[sheet] >= smallest_part]
    if not len(faces):
        raise StageError(
            f"no mesh: of {values.size} pixels {int(usable.sum())} have a usable disparity and none make a part"
            f" that covers {smallest_part:g} pixels; widen the disparity range or lower smallest_part"
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


def _check(
    values: Floats,
    points: Floats,
    method: str,
    error_px: float,
    max_jump_px: float,
    min_angle_deg: float,
    farthest: float,
) -> None:
    if values.ndim != 2 or points.shape != (*values.shape, 3):
        raise InputError(
            f"disparity of shape {values.shape} and points of shape {points.shape} do not fit: pass (H, W) and"
            " (H, W, 3) of one size"
        )
    if method not in METHODS:
        raise InputError(f"method is {method!r:.40}: pass one of {', '.join(METHODS)}")
    if not error_px > 0:
        raise InputError(f"error_px is {error_px}: pass a number above 0")
    if not max_jump_px > 0:
        raise InputError(f"max_jump_px is {max_jump_px}: pass a number above 0")
    if not 0 <= min_angle_deg < 90:
        raise InputError(f"min_angle_deg is {min_angle_deg}: pass degrees from 0 to below 90")
    if not farthest >= 1:
        raise InputError(f"farthest is {farthest}: pass a multiple of the median depth, 1 or more")


def _usable(values: Floats, points: Floats, farthest: float) -> _Mask:
    """(H, W): pixels with a finite disparity and a finite point at a depth with meaning."""
    x, y, depth = points[..., 0], points[..., 1], points[..., 2]
    # A sum is finite only if what it is made of is; in the order of the columns, which is the faster one.
    with np.errstate(invalid="ignore", over="ignore"):
        usable: _Mask = np.isfinite(values) & np.isfinite(x) & np.isfinite(y) & np.isfinite(depth) & (depth > 0)
    if not usable.any():
        raise StageError(
            f"no mesh: none of {values.size} pixels has a disparity with a point before the camera; widen the"
            " disparity range or the mask, or check the calibration"
        )
    limit = farthest * float(np.median(depth[usable]))
    return usable & (depth <= limit)


def _moved(
    points: Floats, faces: Ints, values: Floats, settled: Floats, centre: tuple[float, float, float], infinity_px: float
) -> Floats:
    """Points with those of corners moved along their lines of sight to where other disparities put them."""
    used = np.zeros(len(points), bool)
    used[faces.ravel()] = True
    corner = np.flatnonzero(used)
    eye, infinity = np.asarray(centre, np.float32), np.float32(infinity_px)
    # Depth is inverse to the disparity from that of infinity on.
    farther = (values[corner] - infinity) / (settled[corner] - infinity)
    moved = points.copy()
    moved[corner] = (points[corner] - eye) * farther[:, None] + eye
    return moved
