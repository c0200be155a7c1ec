"""Of two disparity maps, the one whose surroundings cost less: the form for CPUs.

A work-item takes a row, in blocks of columns: first sums of columns, then windows of them, LANES at a time.
"""

import warp as wp

from stereo_gpu.kernels.warp.lanes import LANES, Floats, Ints, aligned, floats, ints, ones_if_nan, place, put

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BLOCK = wp.constant(256)
SPAN = wp.constant(352)  # a block, 32 columns, the largest radius, on either side, and two vectors
MEMORY = wp.constant(1280)  # of sums and windows, their counts, and a vector


@wp.kernel
def merge(
    # In:
    disparity: wp.array(dtype=float),
    lowest: wp.array(dtype=float),
    validity: wp.array(dtype=wp.uint8),
    ratio: wp.array(dtype=float),
    rival_disparity: wp.array(dtype=float),
    rival_lowest: wp.array(dtype=float),
    rival_validity: wp.array(dtype=wp.uint8),
    rival_ratio: wp.array(dtype=float),
    width: int,
    height: int,
    radius: int,
    margin: float,
    # Out:
    disparity_out: wp.array(dtype=float),
    lowest_out: wp.array(dtype=float),
    validity_out: wp.array(dtype=wp.uint8),
    ratio_out: wp.array(dtype=float),
):
    """Take the rival where the mean of lowest - rival_lowest exceeds margin over the (2 radius + 1)^2 pixels around.

    Pixels where either map has no value, or outside of the picture, do not count. Where one map has no value, the
    other is taken. lowest and rival_lowest are whole numbers, whose sums are exact in any order below 2^24.
    """
    y = wp.tid()
    memory = wp.zeros(shape=(MEMORY,), dtype=float)
    gains = aligned(memory.ptr)
    counts = place(gains, SPAN)
    gain = place(counts, SPAN)
    count = place(gain, BLOCK)
    apart = place(count, BLOCK)
    gains_at = wp.array(ptr=gains, shape=(352,), dtype=float)
    counts_at = wp.array(ptr=counts, shape=(352,), dtype=int)
    gain_at = wp.array(ptr=gain, shape=(256,), dtype=float)
    count_at = wp.array(ptr=count, shape=(256,), dtype=int)
    for start in range(0, width, BLOCK):
        columns = wp.min(BLOCK, width - start)
        left = start - radius
        right = wp.min(start + columns + radius, width)
        for k in range(0, columns + 2 * radius + LANES, LANES):
            put(gains, k, Floats(0.0))
            put(counts, k, Ints(0))
        for j in range(wp.max(y - radius, 0), wp.min(y + radius + 1, height)):
            row = j * width
            x = wp.max(left, 0)
            while x + LANES <= right:
                p = row + x
                missing = ones_if_nan(ints(disparity.ptr, p)) | ones_if_nan(ints(rival_disparity.ptr, p))
                put(apart, 0, floats(lowest.ptr, p) - floats(rival_lowest.ptr, p))
                put(apart, 0, ints(apart, 0) & (missing ^ Ints(-1)))
                put(gains, x - left, floats(gains, x - left) + floats(apart, 0))
                put(counts, x - left, ints(counts, x - left) + missing + Ints(1))
                x += LANES
            while x < right:
                p = row + x
                if not wp.isnan(disparity[p]) and not wp.isnan(rival_disparity[p]):
                    gains_at[x - left] = gains_at[x - left] + lowest[p] - rival_lowest[p]
                    counts_at[x - left] = counts_at[x - left] + 1
                x += 1
        for k in range(0, columns, LANES):
            put(gain, k, floats(gains, k))
            put(count, k, ints(counts, k))
            for i in range(1, 2 * radius + 1):
                put(gain, k, floats(gain, k) + floats(gains, k + i))
                put(count, k, ints(count, k) + ints(counts, k + i))
        for k in range(columns):
            pixel = y * width + start + k
            better = gain_at[k] > margin * float(count_at[k])
            if not wp.isnan(rival_disparity[pixel]) and (better or wp.isnan(disparity[pixel])):
                disparity_out[pixel] = rival_disparity[pixel]
                lowest_out[pixel] = rival_lowest[pixel]
                validity_out[pixel] = rival_validity[pixel]
                ratio_out[pixel] = rival_ratio[pixel]
            else:
                disparity_out[pixel] = disparity[pixel]
                lowest_out[pixel] = lowest[pixel]
                validity_out[pixel] = validity[pixel]
                ratio_out[pixel] = ratio[pixel]
