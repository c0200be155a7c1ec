"""Semi-global aggregation along the lines of one direction (Hirschmueller, PAMI 2008, section 2.3): the form for CPUs.

The disparities lie side by side. The range has walls on either side in scratch, which spares the loop every test.
"""

import warp as wp

from stereo_gpu.kernels.warp.lanes import LANES, Bytes, Floats, Ints, aligned, floats, ints, place, put

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

NO_MATCH = wp.constant(255)
UNSEEN = wp.constant(254)
UNSEEN_COST = wp.constant(20.0)
LARGEST_COST = wp.constant(62.0)
PAD = wp.constant(4)  # slopes of up to 3 px a row; kernels/geometry.py computes the same
CHUNK = wp.constant(256)
MEMORY = wp.constant(288)  # a chunk and two vectors
WALL = wp.constant(1.0e9)


@wp.func
def ones_if(value: Ints, wanted: int) -> Ints:
    """Lanes of ones where a whole number from 0 on is the wanted one."""
    return ((value ^ Ints(wanted)) - Ints(1)) >> Ints(31)


@wp.func
def smallest_of(v: Floats) -> float:
    """The smallest lane."""
    best = v[0]
    for lane in range(1, LANES):
        best = wp.min(best, v[lane])
    return best


@wp.kernel
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
    depth jumps at edges. A work-item walks one line; scratch holds L of the last two pixels, 2 x D a line. UNSEEN
    costs UNSEEN_COST, less than a false match, so that a surface goes on where only the other picture ends.
    NO_MATCH costs LARGEST_COST and adds nothing at its own pixel.
    """
    line = wp.tid()
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
    memory = wp.zeros(shape=(MEMORY,), dtype=float)
    low = aligned(memory.ptr)
    own = place(low, LANES)
    before = line * 2 * (disparities + 2 * PAD) + PAD
    now = before + disparities + 2 * PAD
    # A path that comes from nowhere costs nothing, so that the first pixel pays its own cost alone.
    for i in range(-PAD, disparities + PAD):
        scratch[before + i] = 0.0
    cheapest = float(0.0)
    value = picture[y * width + x]
    whole = disparities // LANES * LANES
    backwards = step_x < 0 and step_y == 0
    while x >= 0 and x < width and y >= 0 and y < height:
        for i in range(PAD):
            scratch[now - 1 - i] = WALL
            scratch[now + disparities + i] = WALL
        pixel = y * width + x
        jump = cheapest + wp.where(wp.abs(picture[pixel] - value) > edge, edge_penalty, large_penalty)
        value = picture[pixel]
        old = place(scratch.ptr, before - row_slope * step_y)
        new = place(scratch.ptr, now)
        total = place(volume_out.ptr, 0) + wp.uint64(4) * wp.uint64(pixel) * wp.uint64(disparities)
        paid = cost.ptr + wp.uint64(pixel) * wp.uint64(disparities)
        dearest = LARGEST_COST + large_penalty + 1.0
        put(low, 0, Floats(WALL))
        for chunk in range(0, whole, CHUNK):
            end = wp.min(chunk + CHUNK, whole)
            # Bytes become whole numbers in a loop of their own, or the compiler takes the vectors of both apart.
            for i in range(chunk, end, LANES):
                put(own, i - chunk, Ints(wp.array(ptr=paid + wp.uint64(i), shape=(1,), dtype=Bytes)[0]))
            for k in range(chunk, end, LANES):
                # Where a line leads to ever lower addresses the disparities do too: memory is read ahead one way only.
                i = wp.where(backwards, chunk + end - LANES - k, k)
                near = wp.min(floats(old, i - 1), floats(old, i + 1)) + Floats(small_penalty)
                best = wp.min(wp.min(floats(old, i), Floats(jump)), near)
                unseen = ones_if(ints(own, i - chunk), UNSEEN)
                price = wp.min(ints(own, i - chunk), Ints(62)) + (Ints(20 - 62) & unseen)
                path = Floats(price) + (best - Floats(cheapest))
                put(new, i, path)
                put(low, 0, wp.min(floats(low, 0), path))
                gain = (Floats(dearest) - path) * weight
                matched = Ints(1) + ones_if(ints(own, i - chunk), NO_MATCH)
                put(total, i, floats(total, i) + wp.cw_mul(gain, Floats(matched)))
        next_cheapest = smallest_of(floats(low, 0))
        for i in range(whole, disparities):
            price_here = int(cost[pixel * disparities + i])
            here = wp.min(float(price_here), LARGEST_COST)
            if price_here == UNSEEN:
                here = UNSEEN_COST
            from_index = before + i - row_slope * step_y
            cheaper = wp.min(scratch[from_index], jump)
            cheaper = wp.min(cheaper, scratch[from_index - 1] + small_penalty)
            cheaper = wp.min(cheaper, scratch[from_index + 1] + small_penalty)
            here += cheaper - cheapest
            scratch[now + i] = here
            next_cheapest = wp.min(next_cheapest, here)
            if price_here != NO_MATCH:
                volume_out[pixel * disparities + i] += (dearest - here) * weight
        cheapest = next_cheapest
        swap = before
        before = now
        now = swap
        x += step_x
        y += step_y
