"""Move disparities onto the plane through those surroundings that look alike: the form for CPUs.

A work-item takes a row, in blocks of columns, and sums up for LANES pixels at a time.
"""

import warp as wp

from stereo_gpu.kernels.warp.guide_lanes import BLOCK, LINE, load_guide, load_values, weigh
from stereo_gpu.kernels.warp.lanes import LANES, Floats, aligned, floats, place, put
from stereo_gpu.kernels.warp.likeness import MASKED, furthest
from stereo_gpu.kernels.warp.plane_fit import solve

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

MEMORY = wp.constant(6816)  # 25 lines and a vector
FAR = wp.constant(0x5D5E0B6B)  # the bits of 1e18: from any plane so far that it weighs 0, and 0 times it is 0
# Places of sums: of a row its weight, x and v, then of all rows.
ROW, ROW_X, ROW_V, N, X, Y, V, XX, XY, YY, XV, YV, SUMS = (wp.constant(k * 272) for k in range(13))


@wp.func
def add(sums: wp.uint64, at: int, more: Floats):
    """Add to the sums at a place."""
    put(sums, at, floats(sums, at) + more)


@wp.func
def add_row(
    sums: wp.uint64,
    planes: wp.uint64,
    values: wp.uint64,
    line: wp.uint64,
    weights: wp.uint64,
    dx: float,
    dy: float,
    inverse: float,
    columns: int,
):
    """Add the neighbours that stand dx and dy away to the sums of their row."""
    for k in range(0, columns, LANES):
        v = floats(line, k) - floats(values, k)
        off = v - (floats(planes, k) + floats(planes, 2 * LINE + k) * dy) - floats(planes, LINE + k) * dx
        near = wp.max(Floats(1.0) - wp.cw_mul(off, off) * inverse, Floats(0.0))
        weight = wp.cw_mul(floats(weights, k), wp.cw_mul(near, near))
        weighted_x = weight * dx
        weighted_v = wp.cw_mul(weight, v)
        add(sums, ROW + k, weight)
        add(sums, ROW_X + k, weighted_x)
        add(sums, ROW_V + k, weighted_v)
        add(sums, XX + k, weighted_x * dx)
        add(sums, XV + k, weighted_v * dx)


@wp.func
def end_row(sums: wp.uint64, dy: float, columns: int):
    """Add the sums of a row to those of all rows, and begin a new row."""
    for k in range(0, columns, LANES):
        add(sums, N + k, floats(sums, ROW + k))
        add(sums, X + k, floats(sums, ROW_X + k))
        add(sums, V + k, floats(sums, ROW_V + k))
        add(sums, Y + k, floats(sums, ROW + k) * dy)
        add(sums, XY + k, floats(sums, ROW_X + k) * dy)
        add(sums, YY + k, floats(sums, ROW + k) * (dy * dy))
        add(sums, YV + k, floats(sums, ROW_V + k) * dy)
    for k in range(0, columns, LANES):
        put(sums, ROW + k, Floats(0.0))
        put(sums, ROW_X + k, Floats(0.0))
        put(sums, ROW_V + k, Floats(0.0))


@wp.kernel
def plane_fit(
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
    largest_slope: float,
    # Out:
    disparity_out: wp.array(dtype=float),
):
    """Least squares plane through the pixels around each (within reach, every step-th), in two rounds.

    Through those within tolerance px of the pixel's own disparity, where the tolerance grows by slope px with each
    row or column of distance, then through those within tolerance of that plane. Neighbours weigh by how near they
    are to it (Tukey 1977) and by how much they look like the pixel in the guide, three planes of bytes; masked ones
    not at all. A slope of more than largest_slope px a pixel is a depth jump. No disparity moves by more than
    tolerance.
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
    planes = place(ours, 9 * LINE)  # centre, slopes, and 1 where the first round found one
    sums = place(ours, 13 * LINE)
    at = wp.array(ptr=sums, shape=(SUMS,), dtype=float)
    found = wp.array(ptr=planes, shape=(4 * LINE,), dtype=float)
    for start in range(0, width, BLOCK):
        columns = wp.min(BLOCK, width - start)
        load_guide(guide, pixels, y * width, start, columns, width, ours)
        load_values(disparity, y * width, start, columns, width, FAR, values)
        for k in range(0, 4 * LINE, LANES):
            put(planes, k, Floats(0.0))
        for k in range(columns):
            found[3 * LINE + k] = 1.0
        grows = slope
        for _ in range(2):
            for k in range(0, SUMS, LANES):
                put(sums, k, Floats(0.0))
            for j in range(-half_way, half_way + 1):
                row = (y + j * step) * width
                if y + j * step >= 0 and y + j * step < height:
                    dy = float(j * step)
                    for i in range(-half_way, half_way + 1):
                        allowed = tolerance + grows * float(furthest(i * step, j * step))
                        inverse = 1.0 / (allowed * allowed)
                        weigh(guide, validity, pixels, row, start + i * step, columns, width, ours, theirs, weights)
                        load_values(disparity, row, start + i * step, columns, width, FAR, line)
                        add_row(sums, planes, values, line, weights, float(i * step), dy, inverse, columns)
                    end_row(sums, dy, columns)
            for k in range(columns):
                if found[3 * LINE + k] > 0.0:
                    given = wp.vec3(found[k], found[LINE + k], found[2 * LINE + k])
                    plane = solve(
                        given,
                        at[N + k],
                        at[X + k],
                        at[Y + k],
                        at[V + k],
                        at[XX + k],
                        at[XY + k],
                        at[YY + k],
                        at[XV + k],
                        at[YV + k],
                        largest_slope,
                    )
                    for i in range(4):
                        found[i * LINE + k] = plane[i]
            grows = 0.0
        for k in range(columns):
            pixel = y * width + start + k
            value = disparity[pixel]
            if wp.abs(found[k]) <= tolerance and (int(validity[pixel]) & MASKED) == 0:
                value += found[k]
            disparity_out[pixel] = value
