"""What the writers of models share: a viewer's axes and units, and what a mesh must be."""

from __future__ import annotations

import os
import re
import zlib
from pathlib import Path

import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.types import METRES_PER_UNIT, UNSCALED, Floats, Mesh

# A model without a scale is as large as if the cameras stood a metre apart.
METRES_SHOWN = {**METRES_PER_UNIT, UNSCALED: 1.0}


def to_viewer(points: Floats) -> Floats:
    """Turn (..., 3) from camera axes (x right, y down, z forward) to y up and z towards the viewer."""
    return np.asarray(points * np.array([1, -1, -1], np.float32), np.float32)


def check_mesh(mesh: Mesh) -> None:
    """Refuse a mesh that no file could hold.

    Raises:
        InputError: the unit is unknown, an array's shape does not fit, or a vertex is not finite.
    """
    check_shown(mesh.unit)
    count = len(mesh.vertices)
    shapes = {"vertices": (count, 3), "faces": (len(mesh.faces), 3), "uv": (count, 2)}
    for name, shape in shapes.items():
        if getattr(mesh, name).shape != shape:
            raise InputError(f"{name} of a mesh has shape {getattr(mesh, name).shape}: pass {shape}")
    if mesh.texture.ndim != 3 or mesh.texture.shape[2] != 3 or mesh.texture.dtype != np.uint8:
        raise InputError(f"the texture is {mesh.texture.dtype} of shape {mesh.texture.shape}: pass uint8 (S, T, 3)")
    if not len(mesh.faces) or not (np.isfinite(mesh.vertices).all() and np.isfinite(mesh.uv).all()):
        raise InputError(f"a mesh of {len(mesh.faces)} faces has none or is not finite: build it again")
    if mesh.faces.min() < 0 or mesh.faces.max() >= count:
        raise InputError(f"faces name vertices {mesh.faces.min()} to {mesh.faces.max()} of {count}: build it again")


def check_shown(unit: str) -> None:
    """Refuse a unit of which no metres can be made.

    Raises:
        InputError: it is unknown.
    """
    if unit not in METRES_SHOWN:
        raise InputError(f"unknown unit {unit!r} of a model: its rig must have one of {', '.join(METRES_SHOWN)}")


def plain_stem(path: Path) -> str:
    """What a model's other files are called: its own name in one word, which every program reads whole.

    Where something had to be replaced a checksum keeps two models apart.
    """
    stem = path.with_suffix("").name
    plain = re.sub(r"[^\w.-]", "_", stem).lstrip("-")[:100]
    return stem if plain == stem else f"{plain}_{zlib.crc32(os.fsencode(stem)):08x}"
