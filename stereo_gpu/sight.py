"""Which triangles a camera sees openly, and which it sees too flat to have seen a surface there."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.mesh_parts import covered_pixels, number_parts
from stereo_gpu.types import Floats, Ints

# Steep patches up to this size that nothing much steeper is part of are the noise of single pixels. Cutting them out
# would only riddle a surface with holes.
_PATCH = 3.0  # px

_Mask = NDArray[np.bool_]


def seen_openly(
    points: Floats, faces: Ints, shape: tuple[int, ...], min_angle_deg: float, centre: tuple[float, float, float]
) -> _Mask:
    """Tell faces that lie on surfaces from those drawn out between two objects.

    Args:
        points: (N, 3), that of every pixel.
        faces: (M, 3), as `number_parts` takes them.
        shape: (H, W) of the picture.
        min_angle_deg: the flattest angle at which the line of sight may meet a face. Connected faces under it stay
            where they cover no more than _PATCH px and none is seen under half of the angle, nor from behind.
        centre: where the camera stands.

    Returns:
        (M,): whether a face stays.
    """
    sine = _sine(points, faces, centre)
    kept: _Mask = sine >= math.sin(math.radians(min_angle_deg))
    kept &= sine > 0
    flat = np.flatnonzero(~kept)
    if not len(flat):
        return kept
    part = number_parts(faces[flat], shape)
    large = np.bincount(part, covered_pixels(faces[flat], shape)) > _PATCH
    # NaN, of a triangle without area, is flat as well.
    too_flat = ~(sine[flat] >= math.sin(math.radians(min_angle_deg / 2))) | ~(sine[flat] > 0)
    steep = np.bincount(part, too_flat) > 0
    kept[flat] = ~(large | steep)[part]
    return kept


def _sine(points: Floats, faces: Ints, centre: tuple[float, float, float]) -> Floats:
    """(M,): sine of the angle between each face and the line of sight to it; below 0 from behind."""
    a, b, c = (points[faces[:, i]] for i in range(3))
    # In the order of the columns, since a (M, 3) cross product in numpy costs four times as much.
    px, py, pz = (b - a).T
    qx, qy, qz = (c - a).T
    nx, ny, nz = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
    rx, ry, rz = (a - np.asarray(centre, np.float32)).T
    towards = -(nx * rx + ny * ry + nz * rz)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(towards / np.sqrt((nx * nx + ny * ny + nz * nz) * (rx * rx + ry * ry + rz * rz)))
