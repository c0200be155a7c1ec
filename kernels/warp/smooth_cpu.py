"""Separable Gaussian prefilter: the form for CPUs, whose work-items take a row each, in blocks of columns."""

import warp as wp

from stereo_gpu.kernels.warp.lanes import (
    LANES,
    REPEAT,
    Floats,
    Ints,
    aligned,
    floats,
    ints,
    load_row,
    place,
    put,
    put_some,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BLOCK = wp.constant(256)
MEMORY = wp.constant(560)  # two blocks and three vectors


@wp.kernel
def smooth(
    # In:
    source: wp.array(dtype=float),
    weights: wp.array(dtype=float),
    width: int,
    height: int,
    radius: int,
    axis: int,
    # Out:
    smoothed_out: wp.array(dtype=float),
):
    """Weighted sum of 2 radius + 1 pixels along x (axis 0) or y (axis 1), the picture's edge repeated.

    The second pass (axis 1) rounds to whole grey levels, so that the correlation's sums stay exact.
    """
    y = wp.tid()
    memory = wp.zeros(shape=(MEMORY,), dtype=float)
    totals = aligned(memory.ptr)
    line = place(totals, BLOCK)
    for start in range(0, width, BLOCK):
        columns = wp.min(BLOCK, width - start)
        for k in range(0, columns, LANES):
            put(totals, k, Floats(0.0))
        for i in range(2 * radius + 1):
            weight = weights[i]
            row = y * width
            p = start + i - radius
            if axis == 1:
                row = wp.clamp(y + i - radius, 0, height - 1) * width
                p = start
            load_row(source, row, p, columns, width, 1, REPEAT, line)
            for k in range(0, columns, LANES):
                put(totals, k, floats(totals, k) + weight * floats(line, k))
        for k in range(0, columns, LANES):
            if axis == 1:
                # Rounded towards 0, then down by one where that was up, which the sign of the rest tells.
                total = floats(totals, k) + Floats(0.5)
                whole = Ints(total)
                put(line, 0, total - Floats(whole))
                put(totals, k, Floats(whole + (ints(line, 0) >> Ints(31))))
            put_some(smoothed_out, y * width + start + k, y * width + start + columns, place(totals, k))
