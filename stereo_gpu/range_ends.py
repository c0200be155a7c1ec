"""Tell the first and last disparity of a scene from the surfaces that were found in it."""

from __future__ import annotations

import numpy as np

from stereo_gpu.range_matches import Surfaces
from stereo_gpu.types import Floats

MATCHED = 0.01  # of the wanted pixels, under which nothing is concluded
CORE = 0.05  # share of the pixels on either side that do not belong to the core
FEW = 16  # px at an end, the fringe of a surface, do not count
# An end moves out to where the pixels between, for each px of disparity, are at least this share of the core's. Thin
# things stand out towards the cameras more often than they are seen behind everything else.
NEAR_DENSITY, FAR_DENSITY = 0.003, 0.012
# And at least this share of the picture for each width of disparity, which chance matches have.
NEAR_CHANCE, FAR_CHANCE = 0.01, 0.04
NARROWEST = 0.02  # of the width, the shortest core


def find_ends(found: Surfaces) -> tuple[float, float] | None:
    """First and last disparity, px; None where too little was found to tell.

    The core, without the outer twentieths, and all large surfaces are taken; from there each end moves out as
    long as enough smaller surfaces lie on the way, the more the farther they are: a few pixels just beyond the end
    are believed, the same few far away are taken for chance.
    """
    values = found.values
    if len(values) < max(2 * FEW, MATCHED * found.wanted):
        return None
    low, high = (float(end) for end in np.quantile(values, [CORE, 1 - CORE]))
    density = len(values) / max(high - low, NARROWEST * found.width)
    fringe = found.least // 2
    if len(found.sure) > 2 * fringe:
        low, high = min(low, float(found.sure[fringe])), max(high, float(found.sure[-fringe - 1]))
    near = _move_out(values, high, max(NEAR_DENSITY * density, NEAR_CHANCE * found.height))
    far = _move_out(-values[::-1], -low, max(FAR_DENSITY * density, FAR_CHANCE * found.height))
    return -far, near


def _move_out(values: Floats, end: float, least: float) -> float:
    """Where an end comes to lie if, a px of disparity, at least `least` of the sorted values lie on its way."""
    while True:
        beyond = values[values > end]
        # FEW values at least lie between the end and each of these.
        candidates = beyond[FEW - 1 :]
        enough = np.flatnonzero(np.arange(FEW, len(beyond) + 1) >= least * (candidates - end))
        if not len(enough):
            return end
        end = float(candidates[enough[0]])
