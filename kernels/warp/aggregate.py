"""Semi-global aggregation along the lines of one direction (Hirschmueller, PAMI 2008, section 2.3): for GPUs.

A block walks one line, its threads side by side along the disparities, so that costs and sums are read and written
as they lie. L of the last two pixels lies in shared memory, and in scratch beyond HELD disparities.
"""

import warp as wp

from stereo_gpu.kernels.warp.block import barrier, load, lowest_of_warp, memory, store, warp_size

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

NO_MATCH = wp.constant(255)
UNSEEN = wp.constant(254)
UNSEEN_COST = wp.constant(20.0)
LARGEST_COST = wp.constant(62.0)
GROUP = wp.constant(64)  # kernels/geometry.py has the same,
HELD = wp.constant(256)  # and this
LOWS = wp.constant(512)  # in shared memory, after twice HELD


@wp.func_native(memory(640))
def word(k: int, value: int, write: bool) -> int:
    """Write or read a word of the block's shared memory."""
    ...


@wp.func
def path_at(scratch: wp.array(dtype=float), held: int, rest: int, i: int) -> float:
    """L of disparity i."""
    if i < HELD:
        return wp.cast(word(held + i, 0, False), float)
    return load(scratch, rest + i)


@wp.kernel(launch_bounds=(64, 16), grid_stride=False)
def aggregate(
    # In:
    cost: wp.array(dtype=wp.uint8),
    picture: wp.array(dtype=float),
    width: int,
    height: int,
    disparities: int,
    step_x: int,
    step_y: int,
    row_slope: int,
    small_penalty: float,
    large_penalty: float,
    edge_penalty: float,
    edge: float,
    weight: float,
    lines: int,
    scratch: wp.array(dtype=float),
    # Out:
    volume_out: wp.array(dtype=float),
):
    """Add to volume_out how much cheaper than the dearest path each disparity's path is, times weight.

    L(p, d) = C(p, d) + min(L(q, e), L(q, e +- 1) + small_penalty, min L(q) + P) - min L(q) with q = p - step and
    e = d - row_slope step_y: a surface whose disparity grows by row_slope a row pays nothing for that
    (Scharstein, Taniai, Sinha, 3DV 2017).
    P is large_penalty, or edge_penalty where the picture changes by more than edge grey levels from q to p:
    depth jumps at edges. A block walks one line; scratch holds L of the last two pixels, 2 x D a line. UNSEEN
    costs UNSEEN_COST, less than a false match, so that a surface goes on where only the other picture ends.
    NO_MATCH costs LARGEST_COST and adds nothing at its own pixel.
    """
    line, lane = wp.tid()
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
    cheapest = float(0.0)
    value = load(picture, y * width + x)
    begun = int(0)
    now = int(0)
    while x >= 0 and x < width and y >= 0 and y < height:
        held_before = (1 - now) * HELD
        rest_before = (2 * line + 1 - now) * disparities
        pixel = y * width + x
        jump = cheapest + large_penalty
        if wp.abs(load(picture, pixel) - value) > edge:
            jump = cheapest + edge_penalty
        value = load(picture, pixel)
        low = float(1.0e9)
        for i in range(lane, disparities, GROUP):
            cell = pixel * disparities + i
            own = int(cost[cell])
            path = wp.min(float(own), LARGEST_COST)
            if own == UNSEEN:
                path = UNSEEN_COST
            if begun != 0:
                best = jump
                source = i - row_slope * step_y
                if source >= 0 and source < disparities:
                    best = wp.min(best, path_at(scratch, held_before, rest_before, source))
                if source > 0 and source <= disparities:
                    best = wp.min(best, path_at(scratch, held_before, rest_before, source - 1) + small_penalty)
                if source >= -1 and source < disparities - 1:
                    best = wp.min(best, path_at(scratch, held_before, rest_before, source + 1) + small_penalty)
                path += best - cheapest
            if i < HELD:
                word(now * HELD + i, wp.cast(path, int), True)
            else:
                store(scratch, (2 * line + now) * disparities + i, path)
            low = wp.min(low, path)
            if own != NO_MATCH:
                gain = (LARGEST_COST + large_penalty + 1.0 - path) * weight
                store(volume_out, cell, load(volume_out, cell) + gain)
        word(LOWS + now * GROUP + lane, wp.cast(lowest_of_warp(low), int), True)
        # One barrier a pixel is enough, as the next pixel writes to the other half of everything.
        barrier()
        cheapest = wp.cast(word(LOWS + now * GROUP, 0, False), float)
        for k in range(warp_size(), GROUP, warp_size()):
            cheapest = wp.min(cheapest, wp.cast(word(LOWS + now * GROUP + k, 0, False), float))
        begun = 1
        now = 1 - now
        x += step_x
        y += step_y
