"""What a person should know about a reconstruction: one sentence each, with the way out."""

from __future__ import annotations

from stereo_gpu.rig_check import RigCheck, Verdict
from stereo_gpu.types import Disparity, Validity
from stereo_gpu.unwrap import Unwrapped

LOW_COVERAGE = 0.5
LOW_MEASURED = 0.5
RANGE_HIT = 0.01  # share of the disparities in the last px of the range that says it is cut off; 0.001 are usual


def find_warnings(
    checked: RigCheck, disparity: Disparity, unwrapped: Unwrapped | None, infinity_px: float | None = None
) -> list[str]:
    """Warnings about a reconstruction, the most harmful first; none if all is well.

    Args:
        checked: what matched features tell of the rig and the pair.
        disparity: the map.
        unwrapped: the mesh with its texture coordinates, if one was made.
        infinity_px: disparity of a point at infinity, if it is known.
    """
    found = []
    if checked.verdict is not Verdict.GOOD:
        found.append(f"{checked.says[0].upper()}{checked.says[1:]}.")
    covered = disparity.coverage
    if covered < LOW_COVERAGE:
        found.append(f"Only {covered:.0%} of the wanted pixels have a disparity: too little texture, or a wrong range.")
    elif (measured := _measured(disparity)) < LOW_MEASURED:
        found.append(
            f"Only {measured:.0%} of the wanted pixels were measured, most others are filled in from them: the model is"
            " a guess there, or open; more texture or light helps."
        )
    found += range_warnings(disparity, infinity_px)
    if unwrapped is not None and unwrapped.reason:
        found.append(f"The texture uses {unwrapped.reason}.")
    return found


def _measured(disparity: Disparity) -> float:
    """Share of the pixels that are not masked whose disparity is their own."""
    wanted = (disparity.validity & Validity.MASKED) == 0
    return float((disparity.validity[wanted] == 0).mean())


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
