"""A weak membrane over a part of a disparity map: it is drawn smooth, and breaks where depth jumps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.types import Floats

Places = NDArray[np.intp]


def relax(values: Floats, places: Places, *, max_jump_px: float, slack: float, passes: int) -> None:
    """Move the values at some places to the mean of their neighbours on the same surface, in place.

    After Blake and Zisserman, "Visual Reconstruction", 1987, chapter 3: neighbours pull, unless they are so far off
    that something lies between. What moves starts where it was guessed to be, and so on one surface or another.

    Args:
        values: (H, W) disparities, px, NaN where there is none. Those that do not move hold the others.
        places: (N,) flat indices of those that do; they have a value.
        max_jump_px: a neighbour that is held pulls if it differs by this at most.
        slack: and one that moves, by so many times that.
        passes: how many times.
    """
    width = values.shape[1] + 2
    around = np.pad(values, 1, constant_values=np.nan)
    flat = around.ravel()
    places = places + 2 * (places // values.shape[1]) + width + 1
    neighbours = places + np.array([[-1], [1], [-width], [width]])
    moving = np.zeros(flat.size, bool)
    moving[places] = True
    limit = np.where(moving[neighbours], np.float32(slack * max_jump_px), np.float32(max_jump_px))
    for _ in range(passes):
        step = flat[neighbours] - flat[places]
        # NaN compares as false: what has no value does not pull.
        pulls = np.abs(step) <= limit
        flat[places] += np.where(pulls, step, np.float32(0)).sum(axis=0) / np.maximum(pulls.sum(axis=0), 1)
    values[...] = around[1:-1, 1:-1]
