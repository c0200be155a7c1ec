"""How much of what lies around a pixel both views agree about: the form for CPUs.

A work-item takes a row, in blocks of columns: first counts of columns, LANES at a time, then of windows.
"""

import warp as wp

from stereo_gpu.kernels.warp.box_counts import BLOCK, SPAN, clear_counts, load_flags, sum_counts, window_pixels
from stereo_gpu.kernels.warp.lanes import LANES, Ints, aligned, ints, ones_if_nan, place, put

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

MEMORY = wp.constant(3136)  # three lines and a vector


@wp.kernel
def agreement(
    # In:
    checked: wp.array(dtype=float),
    taken: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    radius: int,
    # Out:
    agreement_out: wp.array(dtype=float),
):
    """Share of the (2 radius + 1)^2 window's pixels that have a value in checked and are not taken.

    checked is NaN where the views disagree. Pixels outside of the picture do not count.
    """
    y = wp.tid()
    memory = wp.zeros(shape=(MEMORY,), dtype=int)
    counts = aligned(memory.ptr)
    flags = place(counts, SPAN)
    before = place(flags, SPAN)
    counted = wp.array(ptr=counts, shape=(SPAN,), dtype=int)
    sums = wp.array(ptr=before, shape=(SPAN,), dtype=int)
    top = wp.max(y - radius, 0)
    bottom = wp.min(y + radius + 1, height)
    room = BLOCK - 2 * radius
    start = int(0)
    while start < width:
        columns = wp.min(room, width - start)
        left = wp.max(start - radius, 0)
        right = wp.min(start + columns + radius, width)
        shift = left - (start - radius)
        clear_counts(counts, columns + 2 * radius)
        for j in range(top, bottom):
            row = j * width + left
            load_flags(taken, row, right - left, flags)
            for k in range(0, right - left - LANES + 1, LANES):
                # Lanes of ones where a pixel does not count.
                no = ones_if_nan(ints(checked.ptr, row + k)) | (Ints(0) - ints(flags, k)) >> Ints(31)
                put(counts, shift + k, ints(counts, shift + k) + no + Ints(1))
            for k in range((right - left) // LANES * LANES, right - left):
                if not wp.isnan(checked[row + k]) and int(taken[row + k]) == 0:
                    counted[shift + k] = counted[shift + k] + 1
        sum_counts(counts, before, columns + 2 * radius)
        for k in range(columns):
            good = sums[k + 2 * radius + 1] - sums[k]
            pixels = window_pixels(start + k, radius, width, bottom - top)
            agreement_out[y * width + start + k] = float(good) / float(pixels)
        start += room
