"""Middlebury's calib.txt (stereo data of 2014 and 2021): two rectified cameras, baseline in mm.

D. Scharstein et al., High-resolution stereo datasets with subpixel-accurate ground truth, GCPR 2014; the format is
told on the page of the data: Z = baseline f / (d + doffs), with doffs = cx1 - cx0.
"""

from __future__ import annotations

import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.rig_files.draft import Draft, DraftCamera
from stereo_gpu.rig_files.tree import Tree, matrix, number, whole

OFFSET_PX = 0.01  # doffs and the principal points are written with three digits


def read_middlebury(values: dict[str, Tree]) -> Draft:
    """A rig from the lines of one file.

    Raises:
        InputError: a value is missing or wrong, or doffs belongs to other principal points.
    """
    numbers = {name: number(name, _value(values, name)) for name in ("doffs", "baseline", "width", "height")}
    matrices = [matrix(name, _value(values, name), (3, 3)) for name in ("cam0", "cam1")]
    apart = float(matrices[1][0, 2]) - float(matrices[0][0, 2])
    if not abs(apart - numbers["doffs"]) <= OFFSET_PX:
        raise InputError(f"doffs is {numbers['doffs']:g}, but cam1 and cam0 are {apart:g} px apart: mend one of them")
    if numbers["baseline"] <= 0:
        raise InputError(f"baseline is {numbers['baseline']:g} mm: it must be above zero")
    size = whole("width", numbers["width"]), whole("height", numbers["height"])
    left, right = (DraftCamera(matrix=found, distortion=np.zeros(5), size=size) for found in matrices)
    return Draft(left=left, right=right, R=np.eye(3), T=np.array([-numbers["baseline"], 0.0, 0.0]), unit="mm")


def _value(values: dict[str, Tree], name: str) -> Tree:
    if name not in values:
        raise InputError(f"it has no {name}: is it Middlebury's calib.txt?")
    return values[name]
