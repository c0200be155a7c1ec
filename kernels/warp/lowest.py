"""Winner takes all over sums of paths: the form for GPUs.

A block owns as many columns of a row as it has threads. CLASSES threads share the search of a pixel, each with every so
many-th disparity, so that they read what lies together; then each thread ends the search of its own column among what
they found.
"""

import warp as wp

from stereo_gpu.kernels.warp.block import barrier, memory, store
from stereo_gpu.kernels.warp.sums import OUT_OF_RANGE, UNMATCHED, lowest_disparity, sums_ratio

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

GROUP = wp.constant(64)  # kernels/geometry.py has the same
CLASSES = wp.constant(8)
PITCH = wp.constant(17)  # two keys a class of a column, and one more, so that columns begin in different banks
INDEX_BITS = wp.constant(15)
INDEX = wp.constant(0x7FFF)
NO_KEY = wp.constant(0x7FFFFFFF)


@wp.func_native(memory(64 * 17))
def word(k: int, value: int, write: bool) -> int:
    """Write or read a word of the block's shared memory."""
    ...


@wp.func_native("return array.data[i];")
def sum_at(array: wp.array(dtype=wp.uint16), i: int) -> wp.uint16:
    """Element i of an array whose elements lie side by side."""
    ...


@wp.kernel(launch_bounds=(64, 16), grid_stride=False)
def lowest(
    # In:
    sums: wp.array(dtype=wp.uint16),
    validity: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    smallest: int,
    disparities: int,
    subpixel: int,
    # Out:
    disparity_out: wp.array(dtype=float),
    lowest_out: wp.array(dtype=float),
    ratio_out: wp.array(dtype=float),
    validity_out: wp.array(dtype=wp.uint8),
):
    """Set each pixel's disparity (px), the lowest of its sums, and how that stands out.

    That is its ratio to the lowest one more than one disparity away. The first of equal sums wins. Where none is under
    UNMATCHED or validity tells a reason there is no disparity, the lowest sum is UNMATCHED, and the ratio 1.
    """
    block, lane = wp.tid()
    tiles = (width + GROUP - 1) // GROUP
    x0 = (block % tiles) * GROUP
    y = block // tiles
    index = lane % CLASSES
    for column in range(lane // CLASSES, wp.min(GROUP, width - x0), GROUP // CLASSES):
        # Neighbouring disparities are in different classes, so that of the winner and its neighbours none hides the
        # lowest one elsewhere.
        own = (y * width + x0 + column) * disparities
        low = int(NO_KEY)
        second = int(NO_KEY)
        for i in range(index, disparities, CLASSES):
            key = (int(sum_at(sums, own + i)) << INDEX_BITS) | i
            second = wp.min(second, wp.max(key, low))
            low = wp.min(low, key)
        word(column * PITCH + 2 * index, low, True)
        word(column * PITCH + 2 * index + 1, second, True)
    barrier()
    if x0 + lane < width:
        pixel = y * width + x0 + lane
        winner = int(NO_KEY)
        for k in range(2 * CLASSES):
            winner = wp.min(winner, word(lane * PITCH + k, 0, False))
        best = winner >> INDEX_BITS
        at = winner & INDEX
        runner = int(NO_KEY)
        for k in range(2 * CLASSES):
            key = word(lane * PITCH + k, 0, False)
            if wp.abs((key & INDEX) - at) > 1:
                runner = wp.min(runner, key)
        known = int(validity[pixel])
        if known != 0 or best >= UNMATCHED:
            store(disparity_out, pixel, wp.nan)
            store(lowest_out, pixel, float(UNMATCHED))
            store(ratio_out, pixel, 1.0)
            validity_out[pixel] = wp.uint8(wp.where(known != 0, known, OUT_OF_RANGE))
        else:
            before = int(UNMATCHED)
            after = int(UNMATCHED)
            if at > 0:
                before = int(sum_at(sums, pixel * disparities + at - 1))
            if at < disparities - 1:
                after = int(sum_at(sums, pixel * disparities + at + 1))
            store(disparity_out, pixel, lowest_disparity(at, best, before, after, smallest, subpixel))
            store(lowest_out, pixel, float(best))
            store(ratio_out, pixel, sums_ratio(best, runner >> INDEX_BITS))
            validity_out[pixel] = wp.uint8(0)
