"""The best peak of a row of scores and how it stands out, seen one score at a time.

Scores count in whole levels, so that one max of a packed key finds a winner, in either view and on any device.
"""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

OUT_OF_RANGE = wp.constant(1)


@wp.func
def index_bits(disparities: int) -> int:
    """Bits that hold the index of a disparity; the 30 - index_bits above them hold the score's level."""
    bits = int(7)  # more levels than a float has would not come back whole
    while (1 << bits) < disparities:
        bits += 1
    return bits


@wp.func
def score_scale(bits: int) -> float:
    """Levels of a score of 1."""
    return float(1 << (30 - bits))


@wp.func
def score_level(score: float, bits: int) -> int:
    """A score's level: at most 1 level of rounding, none over 23 bits; 0 or less is no match."""
    return int(score * score_scale(bits))


@wp.func
def winner_key(level: int, i: int, bits: int) -> int:
    """Level above index, so that one max finds the other view's winner; of equal levels the smaller disparity wins."""
    return level * (1 << bits) + ((1 << bits) - 1 - i)


@wp.func
def key_index(key: int, bits: int) -> int:
    """The index in a key; the key must not be 0, which says that there is no match."""
    return ~key & ((1 << bits) - 1)


@wp.struct
class Peaks:
    """What is known after the levels so far.

    The best one, its place and neighbours, and the runner-up, which is the highest level more than one place away
    from it. earlier is the highest of all but the last one.
    """

    best: int
    index: int
    before: int
    after: int
    runner: int
    last: int
    earlier: int


@wp.func
def no_peaks() -> Peaks:
    """What is known before the first level."""
    peaks = Peaks()
    peaks.index = -2
    return peaks


@wp.func
def see(peaks: Peaks, level: int, i: int) -> Peaks:
    """Take in level number i."""
    positive = wp.max(level, 0)
    if positive > peaks.best:
        peaks.best = positive
        peaks.index = i
        peaks.before = peaks.last
        peaks.after = 0
        peaks.runner = peaks.earlier
    elif i == peaks.index + 1:
        peaks.after = positive
    else:
        peaks.runner = wp.max(peaks.runner, positive)
    peaks.earlier = wp.max(peaks.earlier, peaks.last)
    peaks.last = positive
    return peaks


@wp.func
def peak_disparity(peaks: Peaks, smallest: int, subpixel: int) -> float:
    """The best level's disparity in px, with a parabola through it and its neighbours where both correlate."""
    disparity = float(smallest + peaks.index)
    if subpixel != 0 and peaks.before > 0 and peaks.after > 0:
        bend = (peaks.before - peaks.best) + (peaks.after - peaks.best)
        disparity += 0.5 * float(peaks.before - peaks.after) / float(bend)
    return disparity
