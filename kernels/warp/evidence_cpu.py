"""Step from nearly right disparities to where both pictures fit, and how much they say about it: the form for CPUs.

A work-item takes a row, in blocks of columns: where each sample lies in the other picture is looked up one by one, all
else is computed for LANES pixels at a time.
"""

import warp as wp

from stereo_gpu.kernels.warp.evidence import UNKNOWN, evidence_at, settled
from stereo_gpu.kernels.warp.guide_lanes import BLOCK, LINE, load_guide
from stereo_gpu.kernels.warp.lanes import LANES, REPEAT, Floats, Ints, aligned, floats, ints, load_row, place, put
from stereo_gpu.kernels.warp.likeness import UNLIKE

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FURTHEST = wp.constant(15)  # radius of windows whose row of the reference fits its line; pixel by pixel beyond
OWN = wp.constant(320)  # length of that line: a block, what lies on either side, and a vector
ONE = wp.constant(0x3F800000)  # the bits of 1.0
MEMORY = wp.constant(6592)  # 23 lines, that of the reference, and a vector


@wp.func
def add(sums: wp.uint64, at: int, more: Floats):
    """Add to the sums at a place."""
    put(sums, at, floats(sums, at) + more)


@wp.func
def find_samples(
    values: wp.uint64,
    slopes: wp.uint64,
    x: int,
    i: int,
    j: int,
    width: int,
    way: float,
    columns: int,
    places: wp.uint64,
    shares: wp.uint64,
    weights: wp.uint64,
):
    """Where the samples of column x and of those after it lie, by the line of what they lean with.

    Told are the column of the first of four neighbours, how far beyond the second one a sample lies, and a weight of
    1, or of 0 where one of its neighbours in either picture is outside.
    """
    numbers = wp.array(ptr=places, shape=(LINE,), dtype=int)
    for k in range(LANES):
        numbers[LINE + k] = x + k
    for k in range(0, columns, LANES):
        # Counted from x, so that a part of a picture rounds as the whole of it.
        u = (floats(values, k) + floats(slopes, LINE + k) * float(j) + floats(slopes, k) * float(i)) * way
        put(shares, k, u + Floats(float(i)))
    for k in range(0, columns, LANES):
        # The largest whole number that is not above: one less than what is cut off where that is above.
        put(places, k, Ints(floats(shares, k)))
        put(weights, k, floats(shares, k) - Floats(ints(places, k)))
        put(places, k, ints(places, k) + (ints(weights, k) >> Ints(31)))
        put(shares, k, floats(shares, k) - Floats(ints(places, k)))
    for k in range(0, columns, LANES):
        own = ints(places, LINE) + Ints(k)
        column = ints(places, k) + own
        outside = (column - Ints(1)) | (Ints(width - 3) - column)
        outside = outside | (own + Ints(i - 1)) | (Ints(width - 2 - i) - own)
        put(weights, k, Ints(ONE) & ((outside >> Ints(31)) ^ Ints(-1)))
        put(places, k, wp.max(wp.min(column - Ints(1), Ints(width - 4)), Ints(0)))


@wp.func
def look_up(
    other: wp.array(dtype=float), row: int, first: int, columns: int, stride: int, places: wp.uint64, near: wp.uint64
):
    """The four neighbours of every stride-th sample, a line for each, given the first one's column."""
    numbers = wp.array(ptr=places, shape=(LINE,), dtype=int)
    four = wp.array(ptr=near, shape=(4 * LINE,), dtype=float)
    for k in range(first, columns, stride):
        at = row + numbers[k]
        four[k] = other[at]
        four[LINE + k] = other[at + 1]
        four[2 * LINE + k] = other[at + 2]
        four[3 * LINE + k] = other[at + 3]


@wp.func
def weigh(ours: wp.uint64, theirs: wp.uint64, columns: int, weights: wp.uint64):
    """Multiply weights of 0 or 1 by how much the samples look like the pixels; lines of their colours are given."""
    for k in range(0, columns, LANES):
        apart = wp.abs(ints(theirs, k) - ints(ours, k))
        apart += wp.abs(ints(theirs, LINE + k) - ints(ours, LINE + k))
        apart += wp.abs(ints(theirs, 2 * LINE + k) - ints(ours, 2 * LINE + k))
        t = Floats(wp.max(Ints(UNLIKE) - apart, Ints(0))) * (1.0 / 240.0)
        t = wp.cw_mul(t, t)
        t = wp.cw_mul(t, t)
        put(weights, k, wp.cw_mul(floats(weights, k), wp.cw_mul(t, t)))


@wp.func
def add_samples(
    own: wp.uint64, near: wp.uint64, shares: wp.uint64, weights: wp.uint64, i: int, columns: int, sums: wp.uint64
):
    """Add a sample of each pixel to its sums; i is its place in the line of the reference."""
    for k in range(0, columns, LANES):
        share = floats(shares, k)
        rest = Floats(1.0) - share
        rise = wp.cw_mul(floats(near, 2 * LINE + k) - floats(near, k), rest)
        rise = (rise + wp.cw_mul(floats(near, 3 * LINE + k) - floats(near, LINE + k), share)) * 0.5
        g = (rise + (floats(own, i + k + 1) - floats(own, i + k - 1)) * 0.5) * 0.5
        there = wp.cw_mul(floats(near, LINE + k), rest) + wp.cw_mul(floats(near, 2 * LINE + k), share)
        e = floats(own, i + k) - there
        weight = floats(weights, k)
        weighted_g = wp.cw_mul(weight, g)
        weighted_e = wp.cw_mul(weight, e)
        add(sums, k, weight)
        add(sums, LINE + k, weighted_g)
        add(sums, 2 * LINE + k, weighted_e)
        add(sums, 3 * LINE + k, wp.cw_mul(weighted_g, g))
        add(sums, 4 * LINE + k, wp.cw_mul(weighted_g, e))
        add(sums, 5 * LINE + k, wp.cw_mul(weighted_e, e))


@wp.kernel
def evidence(
    # In:
    reference: wp.array(dtype=float),
    other: wp.array(dtype=float),
    disparity: wp.array(dtype=float),
    along_x: wp.array(dtype=float),
    along_y: wp.array(dtype=float),
    guide: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    radius: int,
    stride: int,
    direction: int,
    weighted: int,
    noise: float,
    damping: float,
    largest_step: float,
    keep: float,
    # Out:
    moved_out: wp.array(dtype=float),
    information_out: wp.array(dtype=float),
    residual_out: wp.array(dtype=float),
):
    """One damped Gauss-Newton step (Lucas and Kanade 1981) over the (2 radius + 1)^2 pixels around.

    Their disparities lean by along_x and along_y px a pixel, and the mean difference of grey levels is removed. The
    gradient is the mean of both pictures' central differences. Samples weigh by how much they look like the pixel in
    the guide, three planes of bytes, where `weighted`, else all the same; those without all their neighbours in both
    rows do not count. residual_out is the variance of the difference after the step; information_out, the inverse of
    the step's variance, the energy of the gradients over that variance and twice `noise`, which is more than 0. The
    step is at most largest_step px, and shrinks by information / (information + keep). Where x or y is no multiple of
    stride, where there is no disparity or where the weights sum up to less than EVIDENCE_ENOUGH, the disparity stays,
    with information 0 and residual UNKNOWN.
    """
    y = wp.tid()
    pixels = width * height
    way = float(direction)
    memory = wp.zeros(shape=(MEMORY,), dtype=float)
    values = aligned(memory.ptr)
    slopes = place(values, LINE)  # along x, then along y
    colours = place(values, 3 * LINE)
    theirs = place(values, 6 * LINE)
    shares = place(values, 9 * LINE)
    weights = place(values, 10 * LINE)
    near = place(values, 11 * LINE)
    sums = place(values, 15 * LINE)
    places = place(values, 21 * LINE)  # and a vector of columns
    own = place(values, 23 * LINE)
    total = wp.array(ptr=sums, shape=(6 * LINE,), dtype=float)
    other_at = wp.array(ptr=other.ptr, shape=(1,), dtype=float)
    by_vectors = radius <= FURTHEST and width >= 4
    for start in range(0, width, BLOCK):
        columns = wp.min(BLOCK, width - start)
        first = (stride - start % stride) % stride
        if y % stride == 0 and by_vectors:
            load_row(disparity, y * width, start, columns, width, 1, REPEAT, values)
            load_row(along_x, y * width, start, columns, width, 1, REPEAT, slopes)
            load_row(along_y, y * width, start, columns, width, 1, REPEAT, place(slopes, LINE))
            if weighted != 0:
                load_guide(guide, pixels, y * width, start, columns, width, colours)
            for k in range(0, 6 * LINE, LANES):
                put(sums, k, Floats(0.0))
            for j in range(-radius, radius + 1):
                row = (y + j) * width
                if y + j >= 0 and y + j < height:
                    load_row(reference, row, start - radius - 1, columns + 2 * radius + 2, width, 1, REPEAT, own)
                    for i in range(-radius, radius + 1):
                        find_samples(values, slopes, start, i, j, width, way, columns, places, shares, weights)
                        look_up(other_at, row, first, columns, stride, places, near)
                        if weighted != 0:
                            load_guide(guide, pixels, row, start + i, columns, width, theirs)
                            weigh(colours, theirs, columns, weights)
                        add_samples(own, near, shares, weights, radius + 1 + i, columns, sums)
        for k in range(columns):
            x = start + k
            pixel = y * width + x
            value = disparity[pixel]
            found = wp.vec3(value, 0.0, UNKNOWN)
            if not wp.isnan(value) and x % stride == 0 and y % stride == 0:
                if by_vectors:
                    found = settled(
                        value,
                        total[k],
                        total[LINE + k],
                        total[2 * LINE + k],
                        total[3 * LINE + k],
                        total[4 * LINE + k],
                        total[5 * LINE + k],
                        way,
                        noise,
                        damping,
                        largest_step,
                        keep,
                    )
                else:
                    found = evidence_at(
                        reference,
                        other,
                        guide,
                        x,
                        y,
                        value,
                        along_x[pixel],
                        along_y[pixel],
                        width,
                        height,
                        radius,
                        direction,
                        weighted,
                        noise,
                        damping,
                        largest_step,
                        keep,
                    )
            moved_out[pixel] = found[0]
            information_out[pixel] = found[1]
            residual_out[pixel] = found[2]
