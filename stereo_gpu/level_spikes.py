"""Draw smooth what is steeper than a surface can be seen, where that is noise and not an edge."""

from __future__ import annotations

import dataclasses
import math

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_gpu.errors import InputError
from stereo_gpu.meshing.membrane import relax
from stereo_gpu.types import Disparity, Floats, Validity

AROUND = 2  # px around steep pixels that are drawn smooth with them
FROM_EDGE = 12.0  # px: nothing is moved so near to what stays steep
LARGEST_NOISE = 1.5  # px: over a larger step from one pixel to the next the membrane does not pull
PASSES = 8  # of it

_Mask = NDArray[np.bool_]


def level_spikes(
    disparity: Disparity,
    *,
    focal_px: float,
    infinity_px: float = 0.0,
    max_jump_px: float = 3.0,
    min_angle_deg: float = 10.0,
) -> Disparity:
    """Take the noise off that a mesh would be torn by.

    Far from the cameras, and where these stand close together, a step of half a pixel from one pixel to the next is a
    wall that runs along the line of sight, which no camera sees: a mesh has to cut there, and gets riddled with holes.
    Such pixels and a little around them are drawn smooth by a weak membrane. Where a step is left then, it is no noise
    but an edge between two surfaces, and all near it stays as it was.

    Args:
        disparity: the map, holes closed.
        focal_px: of the rectified cameras.
        infinity_px: disparity of a point at infinity, cx_left - cx_right.
        max_jump_px: disparity difference over which two pixels are not on one surface, px.
        min_angle_deg: the flattest angle at which a surface is seen, as `build_mesh` has it.

    Returns:
        The map; a pixel that was moved has MISMATCH and FILLED, and confidence 0.

    Raises:
        InputError: an option is out of range.
    """
    if not focal_px > 0:
        raise InputError(f"focal_px is {focal_px}: pass a number of px above 0")
    if not (max_jump_px > 0 and 0 < min_angle_deg < 90):
        raise InputError(
            f"max_jump_px {max_jump_px} and min_angle_deg {min_angle_deg}: pass a number above 0, and 0 to 90 degrees"
        )
    values = disparity.values
    # A pixel is Z / f wide, and a disparity step of s over it Z s / (d - infinity) deep.
    steepest = (values - np.float32(infinity_px)) / np.float32(focal_px * math.tan(math.radians(min_angle_deg)))
    steep = _steep(values, steepest, max_jump_px)
    if not steep.any():
        return disparity
    around = np.ones((2 * AROUND + 1, 2 * AROUND + 1), np.uint8)
    # Closed, so that what a ring of steep pixels surrounds goes with it.
    near = cv2.dilate(cv2.morphologyEx(steep.view(np.uint8), cv2.MORPH_CLOSE, around), around)
    moved = (near != 0) & np.isfinite(values)
    smooth = values.copy()
    pull = min(max_jump_px, LARGEST_NOISE)
    relax(smooth, np.flatnonzero(moved), max_jump_px=pull, slack=1.0, passes=PASSES)
    edge = moved & _steep(smooth, steepest, max_jump_px)
    if edge.any():
        moved &= cv2.distanceTransform((~edge).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5) > FROM_EDGE
    noise = np.uint8(Validity.MISMATCH | Validity.FILLED)
    return dataclasses.replace(
        disparity,
        values=np.where(moved, smooth, values),
        validity=np.where(moved & (disparity.validity == 0), noise, disparity.validity),
        confidence=np.where(moved, np.float32(0), disparity.confidence),
    )


def _steep(values: Floats, steepest: Floats, max_jump_px: float) -> _Mask:
    """(H, W): pixels that differ from the next one by more than `steepest` px, but not by a jump."""
    steep = np.zeros(values.shape, bool)
    for axis in (0, 1):
        first, last = (tuple(part if i == axis else slice(None) for i in (0, 1)) for part in _PAIR)
        step = np.abs(values[last] - values[first])
        # NaN compares as false.
        found = (step > np.minimum(steepest[first], steepest[last])) & (step <= max_jump_px)
        steep[first] |= found
        steep[last] |= found
    return steep


_PAIR = (slice(None, -1), slice(1, None))
