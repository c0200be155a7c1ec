"""Which views do not fit, told by their error among all others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np

from stereo_gpu.boards.board_pairs import FEWEST_PAIRS, BoardPair
from stereo_gpu.errors import CalibrationError
from stereo_gpu.types import Doubles

# Factors of a median, which half of the views cannot spoil; a median deviation would be too strict, since good views
# differ: on two real sets the worst one fits 1.5 and 2.2 times worse than the median, its worst corner 4.6 and 5.5
# times as far off as the spread of all corners.
VIEW_FACTOR = 3.0  # a view that fits this many times worse than the median one is left out
VIEW_FLOOR_PX = 0.1  # but none that fits better than this
CORNER_FACTOR = 12.0  # a corner so many times farther off than the spread of all corners is wrong, and so its view
CORNER_FLOOR_PX = 1.5  # but none that is nearer than this
FEW_CORNERS = 0.25  # of a view: so many wrong ones are told, more are a board that does not fit
MEDIAN_OF_RAYLEIGH = 1.1774  # median distance of a corner, when both coordinates spread by 1


def used_pairs(pairs: list[BoardPair]) -> list[BoardPair]:
    """The pairs that are still in.

    Raises:
        CalibrationError: too few are; with the commonest reasons.
    """
    used = [pair for pair in pairs if not pair.reason]
    if len(used) < FEWEST_PAIRS:
        reasons = Counter(pair.reason.split(":")[0] for pair in pairs if pair.reason)
        told = "; ".join(f"{count} x {reason}" for reason, count in reasons.most_common(3))
        raise CalibrationError(
            f"{len(used)} of {len(pairs)} pairs fit together, {FEWEST_PAIRS} are needed ({told}):"
            " hold the board still and take more"
        )
    return used


def drop_outliers(used: list[BoardPair], distances: list[Doubles], what: str) -> bool:
    """Leave out the views that fit badly, or hold corners that do; only the worst, which spoil the others.

    Args:
        used: the pairs.
        distances: of each pair, (corners,) px between each corner and where it should be.
        what: the reason.

    Returns:
        Whether any was left out.
    """
    errors = np.array([np.sqrt((off**2).mean()) for off in distances])
    worst = np.array([off.max() for off in distances])
    spread = float(np.median(np.concatenate(distances))) / MEDIAN_OF_RAYLEIGH
    wrong_px = max(CORNER_FLOOR_PX, CORNER_FACTOR * spread)
    limit = max(VIEW_FLOOR_PX, VIEW_FACTOR * float(np.median(errors)), float(errors.max()) / 2)
    bad = errors > limit
    if not bad.any():
        bad = worst > max(wrong_px, float(worst.max()) / 2)
    details = {}
    for number in np.flatnonzero(bad).tolist():
        off = distances[number]
        wrong = int((off > wrong_px).sum())
        if 0 < wrong <= FEW_CORNERS * len(off):
            details[number] = f"; {wrong} of {len(off)} corners are off by up to {worst[number]:.1f} px"
    drop(used, errors, np.flatnonzero(bad).tolist(), what, details)
    return bool(bad.any())


def drop(
    used: list[BoardPair], errors: Doubles, numbers: list[int], what: str, details: Mapping[int, str] | None = None
) -> None:
    """Leave pairs out, with their error, the typical one and what more there is to say."""
    for number in numbers:
        detail = (details or {}).get(number, "")
        used[number].drop(f"{what}: {errors[number]:.2f} px, typical {float(np.median(errors)):.2f} px{detail}")
