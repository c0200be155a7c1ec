"""The best and the second best peak of a row of scores, seen one score at a time."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

OUT_OF_RANGE = wp.constant(1)


@wp.struct
class Peaks:
    """What is known after the scores so far; a peak is over its left neighbour and not under its right one."""

    best: float
    index: int
    before: float
    after: float
    second: float
    last: float
    earlier: float


@wp.func
def see(peaks: Peaks, score: float, i: int) -> Peaks:
    """Take in score number i; end a row with one more score, 0. Scores of 0 or less are no match."""
    positive = wp.max(score, 0.0)
    if peaks.last > peaks.earlier and peaks.last >= positive:
        if peaks.last > peaks.best:
            peaks.second = peaks.best
            peaks.best = peaks.last
            peaks.index = i - 1
            peaks.before = peaks.earlier
            peaks.after = positive
        elif peaks.last > peaks.second:
            peaks.second = peaks.last
    peaks.earlier = peaks.last
    peaks.last = positive
    return peaks


@wp.func
def peak_disparity(peaks: Peaks, smallest: int, subpixel: int) -> float:
    """The best peak's disparity in px, with a parabola through it and its neighbours where both correlate."""
    disparity = float(smallest + peaks.index)
    if subpixel != 0 and peaks.before > 0.0 and peaks.after > 0.0:
        bend = (peaks.before - peaks.best) + (peaks.after - peaks.best)
        disparity += 0.5 * (peaks.before - peaks.after) / bend
    return disparity


@wp.func
def winner_key(score: float, i: int) -> int:
    """Score in 18 bits above the disparity's index in 13, so that one max finds the other view's winner.

    Of equal scores the smaller disparity wins; 0 is no match.
    """
    if score <= 0.0:
        return 0
    return int(wp.min(score, 1.0) * 262143.0) * 8192 + (8191 - i)
