"""Drop disparities that those surroundings that look alike do not share: the form for CPUs.

A work-item takes a row, in blocks of columns, and sums up weights for LANES pixels at a time.
"""

import warp as wp

from stereo_gpu.kernels.warp.guide_lanes import BLOCK, LINE, load_guide, load_values, weigh
from stereo_gpu.kernels.warp.guided_support import MISMATCH
from stereo_gpu.kernels.warp.lanes import LANES, Floats, Ints, aligned, chosen, floats, ints, place, put
from stereo_gpu.kernels.warp.likeness import MASKED, furthest

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

MEMORY = wp.constant(3024)  # eleven lines and two vectors
NOWHERE = wp.constant(0x7E967699)  # the bits of 1e38, which agrees with no disparity
QUARTER = wp.constant(0x3E800000)  # the bits of 0.25, what a hole weighs
WHOLE = wp.constant(0x3F800000)  # and of 1


@wp.kernel
def guided_support(
    # In:
    disparity: wp.array(dtype=float),
    validity: wp.array(dtype=wp.uint8),
    guide: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    reach: int,
    step: int,
    tolerance: float,
    slope: float,
    share: float,
    # Out:
    disparity_out: wp.array(dtype=float),
    validity_out: wp.array(dtype=wp.uint8),
):
    """Keep a value that at least share of the pixels around it (within reach, every step-th) have, to tolerance px.

    Pixels count by how much they look like the one in question in the guide, three planes of bytes; those without a
    value count a quarter, against it, and masked ones not at all.

    A surface may lean: the tolerance grows by slope px with each row or column of distance.
    """
    y = wp.tid()
    half_way = reach // step
    pixels = width * height
    memory = wp.zeros(shape=(MEMORY,), dtype=float)
    ours = aligned(memory.ptr)
    theirs = place(ours, 3 * LINE)
    values = place(ours, 6 * LINE)
    line = place(ours, 7 * LINE)
    weights = place(ours, 8 * LINE)
    total = place(ours, 9 * LINE)
    agreeing = place(ours, 10 * LINE)
    some = place(ours, 11 * LINE)
    total_at = wp.array(ptr=total, shape=(BLOCK,), dtype=float)
    agreeing_at = wp.array(ptr=agreeing, shape=(BLOCK,), dtype=float)
    for start in range(0, width, BLOCK):
        columns = wp.min(BLOCK, width - start)
        load_guide(guide, pixels, y * width, start, columns, width, ours)
        load_values(disparity, y * width, start, columns, width, NOWHERE, values)
        for k in range(0, columns, LANES):
            put(total, k, Floats(0.0))
            put(agreeing, k, Floats(0.0))
        for j in range(-half_way, half_way + 1):
            row = (y + j * step) * width
            if y + j * step >= 0 and y + j * step < height:
                for i in range(-half_way, half_way + 1):
                    allowed = tolerance + slope * float(furthest(i * step, j * step))
                    weigh(guide, validity, pixels, row, start + i * step, columns, width, ours, theirs, weights)
                    load_values(disparity, row, start + i * step, columns, width, NOWHERE, line)
                    for k in range(0, columns, LANES):
                        # A negative number where it is nowhere.
                        nowhere = (Ints(NOWHERE - 1) - ints(line, k)) >> Ints(31)
                        put(some, 0, chosen(nowhere, Ints(QUARTER), Ints(WHOLE)))
                        put(total, k, floats(total, k) + wp.cw_mul(floats(weights, k), floats(some, 0)))
                        # How much less than allowed the values differ; its sign says whether they agree.
                        put(some, 0, floats(line, k) - floats(values, k))
                        put(some, 0, ints(some, 0) & Ints(0x7FFFFFFF))
                        put(some, 0, Floats(allowed) - floats(some, 0))
                        put(some, 0, ints(weights, k) & ((ints(some, 0) >> Ints(31)) ^ Ints(-1)))
                        put(agreeing, k, floats(agreeing, k) + floats(some, 0))
        for k in range(columns):
            pixel = y * width + start + k
            value = disparity[pixel]
            reason = int(validity[pixel])
            if agreeing_at[k] < share * total_at[k] and not wp.isnan(value) and (reason & MASKED) == 0:
                value = wp.nan
                reason |= MISMATCH
            disparity_out[pixel] = value
            validity_out[pixel] = wp.uint8(reason)
