"""Semi-global aggregation along the lines of one heading (Hirschmueller, PAMI 2008, section 2.3): the form for CPUs.

A stage is one of the heading's paths, and a work-item walks one line of it. The disparities lie side by side. The range
has walls on either side in scratch, which spares the loop every test.
"""

import warp as wp

from stereo_gpu.kernels.warp.lanes import aligned

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

NO_MATCH = wp.constant(255)
UNSEEN_COST = wp.constant(96)
UNMATCHED = wp.constant(60000)
PAD = wp.constant(4)  # slopes of up to 3 px a row; kernels/geometry.py computes the same
LANES = wp.constant(32)
CHUNK = wp.constant(512)
MEMORY = wp.constant(320)  # a chunk of shorts, and two vectors, in numbers of four bytes
WALL = wp.constant(8000)
Shorts = wp.types.vector(32, wp.int16)
Bytes = wp.types.vector(32, wp.uint8)


@wp.func
def place(address: wp.uint64, k: int) -> wp.uint64:
    """The address k shorts further on."""
    return address + wp.uint64(2) * wp.uint64(k)


@wp.func
def shorts(address: wp.uint64, k: int) -> Shorts:
    """Load the shorts k to k + 31 at an address."""
    held = wp.array(ptr=place(address, k), shape=(1,), dtype=Shorts)
    return held[0]


@wp.func
def put(address: wp.uint64, k: int, value: Shorts):
    """Store the shorts k to k + 31 at an address."""
    held = wp.array(ptr=place(address, k), shape=(1,), dtype=Shorts)
    held[0] = value


@wp.func
def all_lanes(value: int) -> Shorts:
    """The same number in all lanes."""
    return Shorts(wp.int16(value))


@wp.func
def ones_if_no_match(value: Shorts) -> Shorts:
    """Lanes of ones where a cost is NO_MATCH, which is larger than any other."""
    return (all_lanes(254) - value) >> all_lanes(15)


@wp.func
def smallest_of(v: Shorts) -> int:
    """The smallest lane."""
    best = v[0]
    for lane in range(1, LANES):
        best = wp.min(best, v[lane])
    return int(best)


@wp.func
def change_of(guide: wp.array(dtype=wp.uint8), plane: int, p: int, q: int) -> int:
    """How much the guide changes from pixel q to pixel p in the plane where it does most."""
    most = int(0)
    for k in range(3):
        most = wp.max(most, wp.abs(int(guide[k * plane + p]) - int(guide[k * plane + q])))
    return most


@wp.kernel
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
    """What the form for GPUs computes."""
    line = wp.tid()
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
    memory = wp.zeros(shape=(MEMORY,), dtype=float)
    low = aligned(memory.ptr)
    own = place(low, LANES)
    line_length = disparities + 2 * PAD
    lines = scratch.ptr + wp.uint64(4) * wp.uint64(line) * wp.uint64(line_length)
    old = place(lines, PAD)
    new = place(old, line_length)
    before = wp.array(ptr=lines, shape=(2 * line_length,), dtype=wp.int16)
    # A path that comes from nowhere costs nothing, so that the first pixel pays its own cost alone.
    for i in range(line_length):
        before[i] = wp.int16(0)
    for i in range(line_length):
        before[line_length + i] = wp.int16(WALL)
    cheapest = int(0)
    small = int(0)
    jump = int(0)
    begun = int(0)
    shift = row_slope * step_y
    whole = disparities // LANES * LANES
    while x >= 0 and x < width and y >= 0 and y < height:
        pixel = y * width + x
        if begun != 0:
            small = small_penalty
            jump = cheapest + large_penalty
            if change_of(guide, width * height, pixel, pixel - step_y * width - step_x) >= edge:
                small = edge_small_penalty
                jump = cheapest + edge_large_penalty
        total = sums_out.ptr + wp.uint64(2) * wp.uint64(pixel) * wp.uint64(disparities)
        paid = cost.ptr + wp.uint64(pixel) * wp.uint64(disparities)
        put(low, 0, all_lanes(WALL))
        for chunk in range(0, whole, CHUNK):
            end = wp.min(chunk + CHUNK, whole)
            # Bytes become shorts in a loop of their own, or the compiler takes the vectors of both apart.
            for i in range(chunk, end, LANES):
                put(own, i - chunk, Shorts(wp.array(ptr=paid + wp.uint64(i), shape=(1,), dtype=Bytes)[0]))
            for i in range(chunk, end, LANES):
                near = wp.min(shorts(old, i - shift - 1), shorts(old, i - shift + 1)) + all_lanes(small)
                best = wp.min(wp.min(shorts(old, i - shift), all_lanes(jump)), near)
                missing = ones_if_no_match(shorts(own, i - chunk))
                price = shorts(own, i - chunk) + (all_lanes(UNSEEN_COST - NO_MATCH) & missing)
                path = price + (best - all_lanes(cheapest))
                put(new, i, path)
                put(low, 0, wp.min(shorts(low, 0), path))
                if heading != 0:
                    put(total, i, shorts(total, i) + path)
                elif stage == 0:
                    put(total, i, path)
                else:
                    sum = shorts(total, i) + path
                    put(total, i, (sum & (missing ^ all_lanes(-1))) | (all_lanes(UNMATCHED - 65536) & missing))
        next_cheapest = smallest_of(shorts(low, 0))
        here = wp.array(ptr=new, shape=(disparities,), dtype=wp.int16)
        for i in range(whole, disparities):
            price_here = int(cost[pixel * disparities + i])
            # The walls reach PAD places to the left of where the line's array begins.
            left = wp.array(ptr=place(old, i - shift - 1), shape=(3,), dtype=wp.int16)
            cheaper = wp.min(int(left[0]), int(left[2])) + small
            cheaper = wp.min(wp.min(int(left[1]), jump), cheaper)
            path_here = wp.where(price_here == NO_MATCH, UNSEEN_COST, price_here) + cheaper - cheapest
            here[i] = wp.int16(path_here)
            next_cheapest = wp.min(next_cheapest, path_here)
            if heading == 0 and stage == 0:
                sums_out[pixel * disparities + i] = wp.uint16(path_here)
            elif heading == 0 and price_here == NO_MATCH:
                sums_out[pixel * disparities + i] = wp.uint16(UNMATCHED)
            else:
                sums_out[pixel * disparities + i] = wp.uint16(int(sums_out[pixel * disparities + i]) + path_here)
        cheapest = next_cheapest
        if begun == 0:
            # What the first pixel came from has no walls yet.
            for i in range(line_length):
                before[i] = wp.int16(WALL)
        begun = 1
        swap = old
        old = new
        new = swap
        x += step_x
        y += step_y
