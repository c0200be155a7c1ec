"""Drop disparities that their surroundings do not share: the form for CPUs.

A work-item takes a row, in blocks of columns, and counts for LANES pixels at a time.
"""

import warp as wp

from stereo_gpu.kernels.warp.lanes import (
    LANES,
    NOTHING,
    Floats,
    Ints,
    aligned,
    chosen,
    floats,
    ints,
    load_row,
    ones_if_nan,
    place,
    put,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

MISMATCH = wp.constant(8)
BLOCK = wp.constant(256)
MEMORY = wp.constant(1088)  # four blocks and four vectors
NOWHERE = wp.constant(0x7E967699)  # the bits of 1e38, which agrees with no disparity


@wp.func
def load_values(disparity: wp.array(dtype=float), row: int, p: int, columns: int, width: int, to: wp.uint64):
    """Copy columns of a row; what has no value stands far away from any."""
    load_row(disparity, row, p, columns, width, 1, NOTHING, to)
    for k in range(0, columns, LANES):
        bits = ints(to, k)
        put(to, k, chosen(ones_if_nan(bits), Ints(NOWHERE), bits))


@wp.kernel
def support(
    # In:
    disparity: wp.array(dtype=float),
    validity: wp.array(dtype=wp.uint8),
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

    A surface may lean: the tolerance grows by slope px with each row or column of distance.

    Pixels outside the picture or without a value do not share it.
    """
    y = wp.tid()
    half_way = reach // step
    across = 2 * half_way + 1
    enough = share * float(across * across)
    memory = wp.zeros(shape=(MEMORY,), dtype=float)
    values = aligned(memory.ptr)
    line = place(values, BLOCK + LANES)
    agreeing = place(line, BLOCK + LANES)
    apart = place(agreeing, BLOCK + LANES)
    agreeing_at = wp.array(ptr=agreeing, shape=(256,), dtype=int)
    for start in range(0, width, BLOCK):
        columns = wp.min(BLOCK, width - start)
        load_row(disparity, y * width, start, columns, width, 1, NOTHING, values)
        for k in range(0, columns, LANES):
            put(agreeing, k, Ints(0))
        for j in range(-half_way, half_way + 1):
            row = y + j * step
            if row >= 0 and row < height:
                for i in range(-half_way, half_way + 1):
                    allowed = tolerance + slope * float(wp.max(wp.abs(j), wp.abs(i)) * step)
                    load_values(disparity, row * width, start + i * step, columns, width, line)
                    for k in range(0, columns, LANES):
                        # How much less than allowed the values differ; its sign says whether they agree.
                        put(apart, 0, floats(line, k) - floats(values, k))
                        put(apart, 0, ints(apart, 0) & Ints(0x7FFFFFFF))
                        put(apart, 0, Floats(allowed) - floats(apart, 0))
                        put(agreeing, k, ints(agreeing, k) + Ints(1) + (ints(apart, 0) >> Ints(31)))
        for k in range(columns):
            pixel = y * width + start + k
            value = disparity[pixel]
            reason = validity[pixel]
            if float(agreeing_at[k]) < enough and not wp.isnan(value):
                value = wp.nan
                reason = wp.uint8(MISMATCH)
            disparity_out[pixel] = value
            validity_out[pixel] = reason
