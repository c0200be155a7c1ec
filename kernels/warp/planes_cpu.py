"""Fit robust planes through the cells around them: the form for CPUs.

A work-item takes a row of planes, and sums up for LANES of them side by side.
"""

import warp as wp

from stereo_gpu.kernels.warp.lanes import LANES, Floats, Ints, aligned, floats, ints, put
from stereo_gpu.kernels.warp.robust_plane import FIT_ENOUGH, FIT_STIFF, FITS, WIDEST_SCALE, fit_plane, solve

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

HIGHEST = wp.constant(33)  # rows of cells that are held, at most
LINE = wp.constant(128)  # and cells of a row
# Places, in numbers: cells, HIGHEST rows of four lines; sums and planes, a vector each; where the disc begins and ends.
SUMS = wp.constant(16896)
N, X, Y, V, XX, XY, YY, XV, YV = (wp.constant(16896 + 16 * k) for k in range(9))
CENTRE_X, VALUE, ALONG_X, ALONG_Y, FIT, WHOLE, ON_IT, ROOM = (wp.constant(17040 + 16 * k) for k in range(8))
FIRST = wp.constant(17168)
LAST = wp.constant(17204)
MEMORY = wp.constant(17256)  # and a vector


@wp.func
def least_apart(offset: int, cell: int, spacing: int) -> float:
    """How far at least a place in the cells at `offset` from a plane's own first one is from its middle, px."""
    middle = 0.5 * float(cell * spacing - 1)
    begins = float(offset * cell)
    apart = wp.max(wp.max(begins - middle, middle - begins - float(cell - 1)), 0.0)
    return wp.max(apart - 0.5, 0.0)  # rounding may carry a mean out of its cell


@wp.func
def lay_out(held: wp.array(dtype=int), rows: int, cell: int, spacing: int, reach: int):
    """Write where the cells within reach begin and end in each row of cells around a plane."""
    furthest = float(cell * reach)
    for j in range(rows):
        down = least_apart(spacing // 2 - reach + j, cell, spacing)
        held[FIRST + j] = rows
        held[LAST + j] = -1
        for i in range(rows):
            across = least_apart(spacing // 2 - reach + i, cell, spacing)
            if across * across + down * down < furthest * furthest:
                held[FIRST + j] = wp.min(held[FIRST + j], i)
                held[LAST + j] = i


@wp.func
def load_cells(
    cells: wp.array(dtype=float),
    cells_wide: int,
    cells_high: int,
    left: int,
    y: int,
    j: int,
    spacing: int,
    pitch: int,
    to: wp.array(dtype=float),
):
    """Copy a row of cells, every spacing-th beside the other; zeros outside of the picture."""
    for i in range(4):
        for phase in range(spacing):
            for k in range(pitch):
                x = left + phase + k * spacing
                value = float(0.0)
                if y >= 0 and y < cells_high and x >= 0 and x < cells_wide:
                    value = cells[(i * cells_high + y) * cells_wide + x]
                to[(4 * j + i) * LINE + phase * pitch + k] = value


@wp.func
def add(memory: wp.uint64, at: int, more: Floats):
    """Add to the sums at a place."""
    put(memory, at, floats(memory, at) + more)


@wp.func
def add_cells(memory: wp.uint64, at: int, centre_y: float, inverse: float, sharpness: float, fitting: int):
    """Add the cells at `at`, one around each plane, to the sums: to those of a fit, or to those of the share."""
    dx = floats(memory, at + LINE) - floats(memory, CENTRE_X)
    dy = floats(memory, at + 2 * LINE) - Floats(centre_y)
    v = floats(memory, at + 3 * LINE) - floats(memory, VALUE)
    near = wp.max(Floats(1.0) - (wp.cw_mul(dx, dx) + wp.cw_mul(dy, dy)) * inverse, Floats(0.0))
    weight = wp.cw_mul(floats(memory, at), wp.cw_mul(wp.cw_mul(near, near), near))
    off = v - wp.cw_mul(floats(memory, ALONG_X), dx) - wp.cw_mul(floats(memory, ALONG_Y), dy)
    if fitting == 0:
        add(memory, WHOLE, weight)
        put(memory, ROOM, wp.max(off, -off))
        # The bits of floats that are not negative are in their own order.
        near_it = (ints(memory, ROOM) - ints(memory, N) - Ints(1)) >> Ints(31)
        put(memory, ROOM, weight)
        put(memory, ROOM, ints(memory, ROOM) & near_it)
        add(memory, ON_IT, floats(memory, ROOM))
    else:
        off = off * sharpness
        like = wp.cw_div(Floats(1.0), Floats(1.0) + wp.cw_mul(off, off))
        weight = wp.cw_mul(weight, wp.cw_mul(like, like))
        weighted_x = wp.cw_mul(weight, dx)
        weighted_y = wp.cw_mul(weight, dy)
        add(memory, N, weight)
        add(memory, X, weighted_x)
        add(memory, Y, weighted_y)
        add(memory, V, wp.cw_mul(weight, v))
        add(memory, XX, wp.cw_mul(weighted_x, dx))
        add(memory, XY, wp.cw_mul(weighted_x, dy))
        add(memory, YY, wp.cw_mul(weighted_y, dy))
        add(memory, XV, wp.cw_mul(weighted_x, v))
        add(memory, YV, wp.cw_mul(weighted_y, v))


@wp.func
def solve_all(at: wp.array(dtype=float), stiff: float):
    """Take from the sums what they tell of each plane that still has one."""
    for k in range(LANES):
        if not (at[N + k] > FIT_ENOUGH):
            at[FIT + k] = 0.0
        if at[FIT + k] > 0.0:
            plane = solve(
                at[VALUE + k],
                at[N + k],
                at[X + k],
                at[Y + k],
                at[V + k],
                at[XX + k],
                at[XY + k],
                at[YY + k],
                at[XV + k],
                at[YV + k],
                stiff,
            )
            at[VALUE + k] = plane[0]
            at[ALONG_X + k] = plane[1]
            at[ALONG_Y + k] = plane[2]


@wp.kernel
def planes(
    # In:
    cells: wp.array(dtype=float),
    cells_wide: int,
    cells_high: int,
    planes_wide: int,
    planes_high: int,
    cell: int,
    spacing: int,
    reach: int,
    tolerance: float,
    # Out:
    planes_out: wp.array(dtype=float),
):
    """Least squares planes through the cells within `reach`, one in the middle of each spacing x spacing cells.

    Cells weigh by their own weight and (1 - r^2 / R^2)^3 at a distance of r of R px, and from the second of four fits
    on by (1 / (1 + (e / scale)^2))^2 where they are e px off the plane (Geman and McClure 1987), with scales of 4, 2
    and 1 px. Of each plane its value in its middle, its slopes along x and y, and the weight of the cells within
    tolerance px of it over the weight of all, a plane of the output each; NaN and zeros where no cell is near.
    """
    row = wp.tid()
    rows = 2 * reach + 1
    pitch = LANES + 2 * reach // spacing + 1
    if rows > HIGHEST or spacing > HIGHEST or spacing * pitch > LINE:
        for column in range(planes_wide):
            fit_plane(
                cells,
                cells_wide,
                cells_high,
                planes_wide,
                planes_high,
                column,
                row,
                cell,
                spacing,
                reach,
                tolerance,
                planes_out,
            )
        return
    room = wp.zeros(shape=(MEMORY,), dtype=float)
    memory = aligned(room.ptr)
    at = wp.array(ptr=memory, shape=(MEMORY,), dtype=float)
    disc = wp.array(ptr=memory, shape=(MEMORY,), dtype=int)
    lay_out(disc, rows, cell, spacing, reach)
    side = cell * spacing
    centre_y = float(row * side) + 0.5 * float(side - 1)
    furthest = float(cell * reach)
    inverse = 1.0 / (furthest * furthest)
    stiff = FIT_STIFF * float(cell * cell)
    corner = spacing // 2 - reach
    number = planes_wide * planes_high
    for first in range(0, planes_wide, LANES):
        for j in range(rows):
            left = first * spacing + corner
            load_cells(cells, cells_wide, cells_high, left, row * spacing + corner + j, j, spacing, pitch, at)
        for k in range(N, FIRST, LANES):
            put(memory, k, Floats(0.0))
        for k in range(LANES):
            at[CENTRE_X + k] = float((first + k) * side) + 0.5 * float(side - 1)
            at[FIT + k] = 1.0
        sharpness = float(0.0)
        for round in range(FITS + 1):
            for k in range(N, CENTRE_X, LANES):
                put(memory, k, Floats(0.0))
            if round == FITS:
                put(memory, N, Floats(tolerance))
            for j in range(rows):
                for i in range(disc[FIRST + j], disc[LAST + j] + 1):
                    spot = 4 * j * LINE + i % spacing * pitch + i // spacing
                    add_cells(memory, spot, centre_y, inverse, sharpness, wp.where(round < FITS, 1, 0))
            if round < FITS:
                solve_all(at, stiff)
            sharpness = wp.where(sharpness > 0.0, 2.0 * sharpness, 1.0 / WIDEST_SCALE)
        for k in range(wp.min(LANES, planes_wide - first)):
            out = row * planes_wide + first + k
            fits = at[FIT + k] > 0.0
            planes_out[out] = wp.where(fits, at[VALUE + k], wp.nan)
            planes_out[out + number] = wp.where(fits, at[ALONG_X + k], 0.0)
            planes_out[out + 2 * number] = wp.where(fits, at[ALONG_Y + k], 0.0)
            planes_out[out + 3 * number] = wp.where(fits, at[ON_IT + k] / at[WHOLE + k], 0.0)
