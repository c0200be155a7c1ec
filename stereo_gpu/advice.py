"""What a person should know about a reconstruction: one sentence each, with the way out."""

from __future__ import annotations

import numpy as np

from stereo_gpu.check import PairCheck
from stereo_gpu.types import Disparity
from stereo_gpu.unwrap import Unwrapped

LARGE_VERTICAL_PX = 0.5  # rows that differ by more cost matches
LOW_COVERAGE = 0.5
RANGE_HIT = 0.01  # share of the disparities in the last px of the range that says it is cut off; 0.001 are usual


def find_warnings(
    checked: PairCheck, disparity: Disparity, unwrapped: Unwrapped | None, infinity_px: float | None = None
) -> list[str]:
    """Warnings about a reconstruction, the most harmful first; none if all is well.

    Args:
        checked: what matched features tell of the rectified pair.
        disparity: the map.
        unwrapped: the mesh with its texture coordinates, if one was made.
        infinity_px: disparity of a point at infinity, if it is known.
    """
    found = []
    if np.isnan(checked.vertical_px):
        found.append(f"Only {checked.matches} features matched: whether the rows correspond was not checked.")
    elif checked.vertical_px > LARGE_VERTICAL_PX:
        found.append(
            f"Matched features differ by {checked.vertical_px:.2f} px in height (median of {checked.matches}):"
            " the cameras moved since the calibration, or the rig belongs to others. Calibrate again."
        )
    covered = disparity.coverage
    if covered < LOW_COVERAGE:
        found.append(f"Only {covered:.0%} of the wanted pixels have a disparity: too little texture, or a wrong range.")
    found += range_warnings(disparity, infinity_px)
    if unwrapped is not None and unwrapped.reason:
        found.append(f"The texture uses the view's own coordinates instead of charts: {unwrapped.reason}.")
    return found


def range_warnings(disparity: Disparity, infinity_px: float | None = None) -> list[str]:
    """Warnings that the searched range cuts the scene off: many disparities lie at its very end.

    Args:
        disparity: the map.
        infinity_px: disparity of a point at infinity, if it is known: a range need not start lower.
    """
    found = []
    good = disparity.values[disparity.validity == 0]
    if len(good):
        largest = disparity.smallest + disparity.disparities - 1
        ends = [(float((good > largest - 1).mean()), "largest", "end the range higher")]
        if infinity_px is None or disparity.smallest > infinity_px:
            ends.insert(0, (float((good < disparity.smallest + 1).mean()), "smallest", "start the range lower"))
        for share, where, way in ends:
            if share > RANGE_HIT:
                found.append(f"{share:.0%} of the disparities are at the {where} one searched: {way}.")
    return found
