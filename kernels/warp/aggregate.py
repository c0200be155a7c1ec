"""Semi-global aggregation along the lines of one heading (Hirschmueller, PAMI 2008, section 2.3): for GPUs.

A stage is one of the heading's paths. A block walks one line of it, its threads side by side along the disparities, so
that costs and sums are read and written as they lie. L of the last two pixels lies in shared memory, and in scratch
beyond HELD disparities.
"""

import warp as wp

from stereo_gpu.kernels.warp.block import barrier, load, lowest_of_warp, memory, store, warp_size

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

NO_MATCH = wp.constant(255)
UNSEEN_COST = wp.constant(96)
UNMATCHED = wp.constant(60000)
GROUP = wp.constant(64)  # kernels/geometry.py has the same,
HELD = wp.constant(256)  # and this
LOWS = wp.constant(512)  # in shared memory, after twice HELD


@wp.func_native(memory(640))
def word(k: int, value: int, write: bool) -> int:
    """Write or read a word of the block's shared memory."""
    ...


@wp.func_native("return array.data[i];")
def byte_at(array: wp.array(dtype=wp.uint8), i: int) -> wp.uint8:
    """Element i of an array whose elements lie side by side."""
    ...


@wp.func_native("return array.data[i];")
def sum_at(array: wp.array(dtype=wp.uint16), i: int) -> wp.uint16:
    """Element i of an array whose elements lie side by side."""
    ...


@wp.func_native("array.data[i] = wp::uint16(value);")
def put_sum(array: wp.array(dtype=wp.uint16), i: int, value: int):
    """Write element i of an array whose elements lie side by side."""
    ...


@wp.func
def path_at(scratch: wp.array(dtype=float), held: int, rest: int, i: int) -> int:
    """L of disparity i."""
    if i < HELD:
        return word(held + i, 0, False)
    return int(load(scratch, rest + i))


@wp.func
def change_of(guide: wp.array(dtype=wp.uint8), plane: int, p: int, q: int) -> int:
    """How much the guide changes from pixel q to pixel p in the plane where it does most."""
    most = int(0)
    for k in range(3):
        most = wp.max(most, wp.abs(int(byte_at(guide, k * plane + p)) - int(byte_at(guide, k * plane + q))))
    return most


@wp.kernel(launch_bounds=(64, 16), grid_stride=False)
def aggregate(
    # In:
    cost: wp.array(dtype=wp.uint8),
    guide: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    disparities: int,
    heading: int,
    row_slope: int,
    small_penalty: int,
    large_penalty: int,
    edge_small_penalty: int,
    edge_large_penalty: int,
    edge: int,
    stage: int,
    scratch: wp.array(dtype=float),
    # Out:
    sums_out: wp.array(dtype=wp.uint16),
):
    """Set sums_out to, or add to it, the L of each disparity along the heading's paths.

    Heading 0 sets: along the rows, both ways. 1 adds the three paths from the row above, -1 those from the row below.
    L(p, d) = C(p, d) + min(L(q, e), L(q, e +- 1) + small, min L(q) + large) - min L(q) with q = p - step and
    e = d - row_slope step_y: a surface whose disparity grows by row_slope a row pays nothing for that
    (Scharstein, Taniai, Sinha, 3DV 2017). The penalties are the lower ones of an edge where the guide changes by `edge`
    or more from q to p: depth jumps there. NO_MATCH costs UNSEEN_COST along a path, less than a false match, so that a
    surface goes on, and its sum is UNMATCHED. scratch holds L of the last two pixels, 2 x D a line.
    """
    line, lane = wp.tid()
    step_y = heading
    step_x = wp.where(heading == 0, 1 - 2 * stage, wp.where(stage == 2, -1, stage))
    x = int(0)
    y = int(0)
    # Lines start on the row that the step leads away from, then on the column.
    if step_y != 0 and line < width:
        x = line
        y = wp.where(step_y > 0, 0, height - 1)
    else:
        x = wp.where(step_x > 0, 0, width - 1)
        y = line
        if step_y != 0:
            y = line - width + wp.where(step_y > 0, 1, 0)
        if step_x == 0:
            x = width  # paths straight down or up have fewer lines
    cheapest = int(0)
    begun = int(0)
    now = int(0)
    while x >= 0 and x < width and y >= 0 and y < height:
        held_before = (1 - now) * HELD
        rest_before = (2 * line + 1 - now) * disparities
        pixel = y * width + x
        small = int(small_penalty)
        jump = cheapest + large_penalty
        if begun != 0:
            if change_of(guide, width * height, pixel, pixel - step_y * width - step_x) >= edge:
                small = edge_small_penalty
                jump = cheapest + edge_large_penalty
        low = int(0x7FFFFFFF)
        for i in range(lane, disparities, GROUP):
            cell = pixel * disparities + i
            own = int(byte_at(cost, cell))
            path = wp.where(own == NO_MATCH, UNSEEN_COST, own)
            if begun != 0:
                best = jump
                source = i - row_slope * step_y
                if source >= 0 and source < disparities:
                    best = wp.min(best, path_at(scratch, held_before, rest_before, source))
                if source > 0 and source <= disparities:
                    best = wp.min(best, path_at(scratch, held_before, rest_before, source - 1) + small)
                if source >= -1 and source < disparities - 1:
                    best = wp.min(best, path_at(scratch, held_before, rest_before, source + 1) + small)
                path += best - cheapest
            if i < HELD:
                word(now * HELD + i, path, True)
            else:
                store(scratch, (2 * line + now) * disparities + i, float(path))
            low = wp.min(low, path)
            if heading == 0 and stage == 0:
                put_sum(sums_out, cell, path)
            elif heading == 0 and own == NO_MATCH:
                put_sum(sums_out, cell, UNMATCHED)
            else:
                put_sum(sums_out, cell, int(sum_at(sums_out, cell)) + path)
        word(LOWS + now * GROUP + lane, lowest_of_warp(low), True)
        # One barrier a pixel is enough, as the next pixel writes to the other half of everything.
        barrier()
        cheapest = word(LOWS + now * GROUP, 0, False)
        for k in range(warp_size(), GROUP, warp_size()):
            cheapest = wp.min(cheapest, word(LOWS + now * GROUP + k, 0, False))
        begun = 1
        now = 1 - now
        x += step_x
        y += step_y
