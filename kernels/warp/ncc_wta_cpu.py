"""Correlation and winner takes all in one pass that never holds the volume: the form for CPUs.

A work-item owns a strip of rows and takes it in blocks of BLOCK columns. Column sums of products run down the strip,
box sums along the row; both lie with the disparities side by side, so that every vector instruction works on LANES
disparities of one pixel. Columns count in the direction in which the other view's match walks forward, which for the
left view as reference is from the right edge to the left.
"""

import warp as wp

from stereo_gpu.kernels.warp.lanes import (
    LANES,
    REPEAT,
    ZERO,
    Floats,
    Ints,
    aligned,
    floats,
    ints,
    largest,
    load_row,
    place,
    put,
)
from stereo_gpu.kernels.warp.peaks import OUT_OF_RANGE, Peaks, index_bits, peak_disparity, score_scale

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# kernels/geometry.py computes the scratch from the same constants.
BLOCK = wp.constant(64)
TILE = wp.constant(16)  # pixels whose keys are held until the other view has looked at them


@wp.func
def add_row(ours: wp.uint64, theirs: wp.uint64, sums: wp.uint64, used: int, padded: int):
    """Add the products of the row that enters to the column sums, while the strip's first window fills."""
    own = wp.array(ptr=ours, shape=(used,), dtype=float)
    for c in range(used):
        value = own[c]
        for i in range(0, padded, LANES):
            put(sums, c * padded + i, floats(sums, c * padded + i) + value * floats(theirs, c + i))


@wp.func
def column_sum(
    entering: float,
    leaving: float,
    their_entering: wp.uint64,
    their_leaving: wp.uint64,
    column: wp.uint64,
    c: int,
    i: int,
) -> Floats:
    """Move a column's sums of products down by a row."""
    total = floats(column, i) + (entering * floats(their_entering, c + i) - leaving * floats(their_leaving, c + i))
    put(column, i, total)
    return total


@wp.func
def keep(highest: wp.uint64, key: Ints):
    """Take in keys: of each lane the highest and the second highest, which stand side by side in memory."""
    high = ints(highest, 0)
    put(highest, LANES, wp.max(ints(highest, LANES), wp.min(high, key)))
    put(highest, 0, wp.max(high, key))


@wp.kernel
def ncc_wta(
    # In:
    reference: wp.array(dtype=float),
    other: wp.array(dtype=float),
    reference_sum: wp.array(dtype=float),
    reference_inverse: wp.array(dtype=float),
    other_sum: wp.array(dtype=float),
    other_inverse: wp.array(dtype=float),
    validity: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    smallest: int,
    disparities: int,
    radius: int,
    direction: int,
    subpixel: int,
    rows: int,
    scratch: wp.array(dtype=float),
    # Out:
    disparity_out: wp.array(dtype=float),
    score_out: wp.array(dtype=float),
    ratio_out: wp.array(dtype=float),
    validity_out: wp.array(dtype=wp.uint8),
    other_out: wp.array(dtype=int),
):
    """What ncc_volume followed by wta computes, without the volume; other_out must come in as 0."""
    strip = wp.tid()
    first = strip * rows
    last = wp.min(first + rows, height)
    padded = (disparities + LANES - 1) / LANES * LANES
    whole = disparities / LANES * LANES
    columns = BLOCK + 2 * radius
    span = (columns + padded + 2 * LANES - 1) / LANES * LANES
    key_row = padded + 2 * (TILE + LANES)
    bits = index_bits(disparities)
    mask = (1 << bits) - 1
    count = float((2 * radius + 1) * (2 * radius + 1))
    scale = score_scale(bits)

    # Scratch of this strip; kernels/geometry.py computes the same size.
    floats_a_strip = padded * (columns + 1) + TILE * key_row + 7 * span + 2 * BLOCK + (2 * TILE + 1) * LANES + 2 * TILE
    sums = place(aligned(scratch.ptr), 0) + wp.uint64(4) * wp.uint64(strip) * wp.uint64(floats_a_strip)
    box = place(sums, padded * columns)
    keys = place(box, padded + TILE + LANES)  # a row of keys has zeros on either side
    entering = place(keys, TILE * key_row - TILE - LANES)
    leaving = place(entering, span)
    their_entering = place(leaving, span)
    their_leaving = place(their_entering, span)
    sum_u = place(their_leaving, span)
    inverse_u = place(sum_u, span)
    key_u = place(inverse_u, span)
    mean_x = place(key_u, span)
    inverse_x = place(mean_x, BLOCK)
    counting = place(inverse_x, BLOCK)  # the index part of the first LANES keys
    highest = place(counting, LANES)  # of each pixel of a tile, of each lane: the highest and second highest key
    best_at = wp.array(ptr=place(highest, 2 * TILE * LANES), shape=(16,), dtype=int)
    runner_at = wp.array(ptr=place(highest, 2 * TILE * LANES + TILE), shape=(16,), dtype=int)

    key_at = wp.array(ptr=place(box, padded), shape=(TILE * key_row,), dtype=int)
    for k in range(TILE * key_row):
        key_at[k] = 0
    count_at = wp.array(ptr=counting, shape=(16,), dtype=int)
    for k in range(LANES):
        count_at[k] = mask - k
    key_of = wp.array(ptr=keys, shape=(TILE * key_row,), dtype=int)
    entering_at = wp.array(ptr=entering, shape=(span,), dtype=float)
    leaving_at = wp.array(ptr=leaving, shape=(span,), dtype=float)
    mean_at = wp.array(ptr=mean_x, shape=(64,), dtype=float)
    inverse_at = wp.array(ptr=inverse_x, shape=(64,), dtype=float)
    key_u_at = wp.array(ptr=key_u, shape=(span,), dtype=int)

    for start in range(0, width, BLOCK):
        block = wp.min(BLOCK, width - start)
        used = block + 2 * radius
        for k in range(0, padded * used, LANES):
            put(sums, k, Floats(0.0))
        for y in range(first - 2 * radius, last):
            row_in = wp.clamp(y + radius, 0, height - 1) * width
            # The row that left the window when it moved down to y; before the first row nothing has.
            row_out = wp.clamp(y - radius - 1, 0, height - 1) * width
            p = start - radius
            load_row(reference, row_in, p, used, width, direction, REPEAT, entering)
            load_row(other, row_in, p + smallest, used + padded, width, direction, REPEAT, their_entering)
            if y < first:
                add_row(entering, their_entering, sums, used, padded)
                continue
            load_row(other, row_out, p + smallest, used + padded, width, direction, REPEAT, their_leaving)
            if y > first:
                load_row(reference, row_out, p, used, width, direction, REPEAT, leaving)
            else:
                for k in range(0, used, LANES):
                    put(leaving, k, Floats(0.0))
            load_row(other_sum, y * width, start + smallest, block + padded, width, direction, ZERO, sum_u)
            load_row(other_inverse, y * width, start + smallest, block + padded, width, direction, ZERO, inverse_u)
            for k in range(0, block + padded, LANES):
                put(key_u, k, Ints(0))
            load_row(reference_sum, y * width, start, block, width, direction, REPEAT, mean_x)
            load_row(reference_inverse, y * width, start, block, width, direction, REPEAT, inverse_x)
            for k in range(0, block, LANES):
                put(mean_x, k, floats(mean_x, k) / count)
                put(inverse_x, k, floats(inverse_x, k) * scale)

            for i in range(0, padded, LANES):
                put(box, i, Floats(0.0))
            for c in range(2 * radius):
                column = place(sums, c * padded)
                own_in = entering_at[c]
                own_out = leaving_at[c]
                for i in range(0, padded, LANES):
                    total = column_sum(own_in, own_out, their_entering, their_leaving, column, c, i)
                    put(box, i, floats(box, i) + total)
            for tile in range(0, block, TILE):
                length = wp.min(TILE, block - tile)
                for t in range(length):
                    x = tile + t
                    key_x = place(keys, t * key_row)
                    c = x + 2 * radius
                    column = place(sums, c * padded)
                    gone = place(sums, x * padded)
                    own_in = entering_at[c]
                    own_out = leaving_at[c]
                    mean = mean_at[x]
                    inverse = inverse_at[x]
                    held = place(highest, 2 * t * LANES)
                    put(held, 0, Ints(0))
                    put(held, LANES, Ints(0))
                    i = int(0)
                    while i < padded:
                        total = floats(box, i) + column_sum(
                            own_in, own_out, their_entering, their_leaving, column, c, i
                        )
                        put(box, i, total - floats(gone, i))
                        # This order of operations is the same in every form of the correlation, so that all agree.
                        score = wp.cw_mul((total - mean * floats(sum_u, x + i)) * inverse, floats(inverse_u, x + i))
                        key = Ints(score) * (1 << bits) + (ints(counting, 0) - Ints(i))
                        put(key_x, i, key)
                        if i >= whole:
                            for k in range(disparities, padded):
                                key_of[t * key_row + k] = 0
                        keep(held, ints(key_x, i))
                        i += LANES
                # A maximum over lanes beside other uses of the same vector would take both apart: a loop for each.
                for t in range(length):
                    best_at[t] = largest(ints(highest, 2 * t * LANES))
                for t in range(length):
                    # The runner-up is not the winner's neighbour; a lane holds at most one of the three.
                    high = ints(highest, 2 * t * LANES)
                    away = Ints((best_at[t] & mask) + 1) - (high & Ints(mask))
                    apart = (away | (Ints(2) - away)) >> Ints(31)  # all bits are set unless away is 0, 1 or 2
                    put(highest, 2 * t * LANES, wp.max(ints(highest, (2 * t + 1) * LANES), high & apart))
                for t in range(length):
                    runner_at[t] = largest(ints(highest, 2 * t * LANES))
                for t in range(length):
                    x = tile + t
                    best = best_at[t]
                    at = mask - (best & mask)
                    peaks = Peaks()
                    peaks.best = best >> bits
                    peaks.index = at
                    peaks.runner = runner_at[t] >> bits
                    if at > 0:
                        peaks.before = key_of[t * key_row + at - 1] >> bits
                    if at < disparities - 1:
                        peaks.after = key_of[t * key_row + at + 1] >> bits
                    pixel = y * width + wp.where(direction > 0, start + x, width - 1 - start - x)
                    score_out[pixel] = float(peaks.best) / scale
                    disparity_out[pixel] = wp.nan
                    ratio_out[pixel] = 0.0
                    validity_out[pixel] = validity[pixel]
                    if peaks.best > 0:
                        disparity_out[pixel] = peak_disparity(peaks, smallest, subpixel)
                        ratio_out[pixel] = float(peaks.runner) / float(peaks.best)
                    elif validity[pixel] == wp.uint8(0):
                        validity_out[pixel] = wp.uint8(OUT_OF_RANGE)
                for t in range(length, TILE):
                    for i in range(0, padded, LANES):
                        put(keys, t * key_row + i, Ints(0))
                for k in range(0, padded + TILE, LANES):
                    high = ints(key_u, tile + k)
                    for t in range(TILE):
                        high = wp.max(high, ints(keys, t * key_row + k - t))
                    put(key_u, tile + k, high)
            for k in range(block + padded):
                u = start + smallest + k
                if u >= 0 and u < width and key_u_at[k] > mask:
                    match = y * width + wp.where(direction > 0, u, width - 1 - u)
                    other_out[match] = wp.max(other_out[match], key_u_at[k])
