"""Which triangles a camera sees openly, and which it sees too flat to have seen a surface there."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.backends import Backend
from stereo_gpu.meshing.parts import number_parts
from stereo_gpu.types import Floats, Ints

# What hangs together with a face that is cut is cut up to so many times the angle: the flanks of a step.
_FLANKS = 2.4
# Not on surfaces that lean by more than this as a whole, px a pixel, looked at so many px away: a table seen at a
# grazing angle falls in steps, too.
_LEANING, _REACH = 0.5, 16
_STEEPEST = 3.0  # px a pixel; anything above is a jump

_Mask = NDArray[np.bool_]


def seen_openly(
    points: Floats,
    faces: Ints,
    shape: tuple[int, ...],
    min_angle_deg: float,
    centre: tuple[float, float, float],
    leaning: _Mask | None,
) -> _Mask:
    """Tell faces that lie on surfaces from those drawn out between two objects.

    A drawn-out band is steepest in its middle, and its flanks would be left as slivers. So it is found by two
    thresholds, as Canny finds edges (1986): all of a connected patch of steep faces goes if one of them is too steep.

    Args:
        points: (N, 3), that of every pixel.
        faces: (M, 3), as `number_parts` takes them.
        shape: (H, W) of the picture.
        min_angle_deg: the flattest angle at which the line of sight may meet a face.
        centre: where the camera stands.
        leaning: (H, W), whether a surface leans as a whole, from `find_leaning`; its faces go alone. None for all.

    Returns:
        (M,): whether a face stays.
    """
    sine = _sine(points, faces, centre)
    # Comparisons with NaN, of a triangle without area, are false: it goes.
    open_: _Mask = (sine >= math.sin(math.radians(min_angle_deg))) & (sine > 0)
    if leaning is None:
        return open_
    steep = np.flatnonzero(~(sine >= math.sin(math.radians(min(_FLANKS * min_angle_deg, 90)))))
    steep = steep[~(open_[steep] & leaning.ravel()[faces[steep]].all(axis=1))]
    if len(steep):
        patch = number_parts(faces[steep], shape)
        open_[steep] = (np.bincount(patch, ~open_[steep]) == 0)[patch]
    return open_


def find_leaning(device: Backend, values: Floats) -> _Mask:
    """(H, W): where a disparity map leans by more than _LEANING px a pixel over 2 _REACH pixels."""
    height, width = values.shape
    along_x, along_y = (device.empty(values.shape, np.float32) for _ in range(2))
    device.launch(
        "slopes",
        disparity=device.upload(values),
        width=width,
        height=height,
        reach=_REACH,
        largest=_STEEPEST,
        along_x_out=along_x,
        along_y_out=along_y,
    )
    x, y = device.download(along_x), device.download(along_y)
    return np.asarray(x * x + y * y > _LEANING * _LEANING)


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
