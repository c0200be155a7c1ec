"""Write a cloud of coloured points as binary PLY."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.export_frame import to_viewer
from stereo_gpu.files import write_whole
from stereo_gpu.types import Bytes, Floats

_VERTEX = np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3)])


def write_ply(path: str | os.PathLike[str], points: Floats, colours: Bytes) -> Path:
    """Write the finite ones of (..., 3) points with their (..., 3) RGB colours, little endian.

    The axes are those of the other files (y up, z towards the viewer), lengths stay in the points' unit. A cloud
    without a finite point is a valid file with no vertex.

    Raises:
        InputError: points and colours do not fit, or the file cannot be written.
    """
    if points.shape != colours.shape or points.shape[-1:] != (3,) or colours.dtype != np.uint8:
        raise InputError(
            f"points of shape {points.shape} and {colours.dtype} colours of shape {colours.shape} do not fit:"
            " pass (..., 3) and uint8 (..., 3)"
        )
    finite = np.isfinite(points).all(axis=-1)
    vertices = np.empty(int(finite.sum()), _VERTEX)
    vertices["xyz"] = to_viewer(points[finite])
    vertices["rgb"] = colours[finite]
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        "comment stereo-gpu: y up, z towards the viewer\n"
        f"element vertex {len(vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\n"
        "end_header\n"
    )
    return write_whole(path, header.encode() + vertices.tobytes())
