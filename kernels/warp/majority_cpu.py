"""Take planes where most of the surroundings want them: the form for CPUs.

A work-item takes a row, in blocks of columns: first counts of columns, LANES at a time, then of windows.
"""

import warp as wp

from stereo_gpu.kernels.warp.box_counts import BLOCK, SPAN, clear_counts, load_flags, sum_counts, window_pixels
from stereo_gpu.kernels.warp.lanes import LANES, Ints, aligned, ints, place, put

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

MEMORY = wp.constant(3136)  # three lines and a vector


@wp.kernel
def majority(
    # In:
    wanted: wp.array(dtype=wp.uint8),
    plane: wp.array(dtype=float),
    disparity: wp.array(dtype=float),
    width: int,
    height: int,
    radius: int,
    # Out:
    disparity_out: wp.array(dtype=float),
    taken_out: wp.array(dtype=wp.uint8),
):
    """Take a pixel's plane, where it has one, if at least half of the (2 radius + 1)^2 pixels around want theirs.

    Pixels outside of the picture do not count.
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
            load_flags(wanted, row, right - left, flags)
            for k in range(0, right - left - LANES + 1, LANES):
                # Lanes of ones where a plane is wanted.
                put(counts, shift + k, ints(counts, shift + k) - ((Ints(0) - ints(flags, k)) >> Ints(31)))
            for k in range((right - left) // LANES * LANES, right - left):
                if int(wanted[row + k]) != 0:
                    counted[shift + k] = counted[shift + k] + 1
        sum_counts(counts, before, columns + 2 * radius)
        for k in range(columns):
            pixel = y * width + start + k
            want = sums[k + 2 * radius + 1] - sums[k]
            surface = plane[pixel]
            if 2 * want >= window_pixels(start + k, radius, width, bottom - top) and not wp.isnan(surface):
                disparity_out[pixel] = surface
                taken_out[pixel] = wp.uint8(1)
            else:
                disparity_out[pixel] = disparity[pixel]
                taken_out[pixel] = wp.uint8(0)
        start += room
