"""Median of the valid neighbours: the form for CPUs.

A work-item owns a row and takes it in blocks of columns. Every lane of a vector is one pixel's window, which a
sorting network puts in order by compare and exchange alone (K. E. Batcher, Sorting networks and their applications,
1968). The numbers are compared as whole ones: the bits of a float are in its order once those of a negative one,
but the sign, are inverted.
"""

import warp as wp

from stereo_gpu.kernels.warp.lanes import (
    LANES,
    NOTHING,
    Ints,
    aligned,
    chosen,
    ints,
    load_row,
    ones_if_nan,
    place,
    put,
    put_some,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BLOCK = wp.constant(128)
LINE = wp.constant(160)  # a block, its surroundings and a whole vector
LINES = wp.constant(1296)  # those of the largest window, one for what is missing, and a vector
WINDOW = wp.constant(816)  # a vector for each of its pixels and two more
ABSENT = wp.constant(0x7FFFFFFF)
NAN_BITS = wp.constant(0x7FC00000)


@wp.func
def in_order(bits: Ints) -> Ints:
    """Whole numbers in the order of the floats whose bits they are; the way back is the same."""
    return bits ^ ((bits >> Ints(31)) & Ints(0x7FFFFFFF))


@wp.func
def exchange(window: wp.uint64, a: int, b: int):
    """Put the lower of numbers a and b in place a, the higher one in place b."""
    one = ints(window, a * LANES)
    two = ints(window, b * LANES)
    put(window, a * LANES, wp.min(one, two))
    put(window, b * LANES, wp.max(one, two))


@wp.func
def sort(window: wp.uint64, total: int):
    """Put so many vectors in order, each lane for itself."""
    p = int(1)
    while p < total:
        k = int(p)
        while k >= 1:
            start = k % p
            while start + k < total:
                a = int(start)
                end = wp.where((start + k) & (2 * p - 1) == 0, 0, wp.min(start + k, total - k))
                while a < end:
                    exchange(window, a, a + k)
                    a += 1
                start += 2 * k
            k = k // 2
        p = 2 * p


@wp.kernel
def median(
    # In:
    disparity: wp.array(dtype=float),
    width: int,
    height: int,
    size: int,
    # Out:
    disparity_out: wp.array(dtype=float),
):
    """Median over size x size (3, 5 or 7) neighbours that have a value; of an even number the lower one.

    A pixel without a value stays without. Missing neighbours count as highest, beyond the middle of the rest.
    """
    y = wp.tid()
    radius = size // 2
    total = size * size
    line_memory = wp.zeros(shape=(LINES,), dtype=int)
    window_memory = wp.zeros(shape=(WINDOW,), dtype=int)
    lines = aligned(line_memory.ptr)  # a line for each row of the window
    missing = place(lines, 7 * LINE)  # how many of each column have no value, negative
    window = aligned(window_memory.ptr)
    middle = place(window, 49 * LANES)
    window_at = wp.array(ptr=window, shape=(WINDOW,), dtype=int)
    middle_at = wp.array(ptr=middle, shape=(16,), dtype=int)
    for start in range(0, width, BLOCK):
        columns = wp.min(BLOCK, width - start)
        for k in range(0, columns + 2 * radius, LANES):
            put(missing, k, Ints(0))
        for j in range(size):
            line = place(lines, j * LINE)
            row = y + j - radius
            # Beyond the first and the last row a place that is no column of any row is read: there is nothing.
            inside = wp.where(row >= 0 and row < height, start - radius, width)
            row = wp.clamp(row, 0, height - 1)
            load_row(disparity, row * width, inside, columns + 2 * radius, width, 1, NOTHING, line)
            for k in range(0, columns + 2 * radius, LANES):
                bits = ints(line, k)
                absent = ones_if_nan(bits)
                put(line, k, chosen(absent, Ints(ABSENT), in_order(bits)))
                put(missing, k, ints(missing, k) + absent)
        for x in range(0, columns, LANES):
            for j in range(size):
                for i in range(size):
                    put(window, (j * size + i) * LANES, ints(lines, j * LINE + x + i))
            sort(window, total)
            put(middle, 0, Ints(total))
            for i in range(size):
                put(middle, 0, ints(middle, 0) + ints(missing, x + i))
            for lane in range(LANES):
                middle_at[lane] = window_at[wp.max(middle_at[lane] - 1, 0) // 2 * LANES + lane]
            here = ints(lines, radius * LINE + radius + x)
            absent = (Ints(ABSENT - 1) - here) >> Ints(31)
            put(middle, 0, chosen(absent, Ints(NAN_BITS), in_order(ints(middle, 0))))
            put_some(disparity_out, y * width + start + x, y * width + start + columns, middle)
