"""What a winner among sums of paths means."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

OUT_OF_RANGE = wp.constant(1)
UNMATCHED = wp.constant(60000)  # sums from here on are no match
FAINT = wp.constant(100)  # about what two places on a flat surface differ by


@wp.func
def lowest_disparity(index: int, best: int, before: int, after: int, smallest: int, subpixel: int) -> float:
    """The lowest sum's disparity in px, with a parabola through it and its neighbours where both match.

    before is higher than the lowest one.
    """
    disparity = float(smallest + index)
    if subpixel != 0 and before < UNMATCHED and after < UNMATCHED:
        disparity += 0.5 * float(before - after) / float((before - best) + (after - best))
    return disparity


@wp.func
def sums_ratio(best: int, runner: int) -> float:
    """How the winner stands out: its sum over the lowest one elsewhere, both with FAINT added; 1 where none is."""
    ratio = float(1.0)
    if runner < UNMATCHED:
        ratio = float(best + FAINT) / float(runner + FAINT)
    return ratio
