"""Semi-global aggregation along the lines of one heading (Hirschmueller, PAMI 2008, section 2.3): for GPUs.

A stage is one of the heading's paths. LANES threads, a warp, walk one line of it, side by side along the disparities,
so that costs and sums are read and written as they lie; a block has two such lines. What a step takes from the device's
memory is asked for AHEAD steps before, since a step is far shorter than the way there. A step is CHUNK disparities of a
pixel. L of the last two pixels lies in shared memory, or in scratch beyond HELD disparities.
"""

import warp as wp

from stereo_gpu.kernels.warp.block import lowest_of_warp, memory, warp_size

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

NO_MATCH = wp.constant(255)
UNSEEN_COST = wp.constant(96)
UNMATCHED = wp.constant(60000)
LINES = wp.constant(2)  # kernels/geometry.py has the same,
HELD = wp.constant(256)  # and this
LANES = wp.constant(32)
EACH = wp.constant(4)  # disparities of a thread in a step
CHUNK = wp.constant(128)  # EACH x LANES
AHEAD = wp.constant(4)
PAD = wp.constant(3)  # disparities out of range beside those that are held
ROOM = wp.constant(262)  # HELD and both pads
NOWHERE = wp.constant(65535)  # more than any L, whose sums have 16 bits
FAR = wp.constant(1 << 30)
EDGES = wp.constant(128)  # in shared memory, after LINES x 2 x LANES lowest L

# What AHEAD steps take: EACH costs or sums of each.
Asked = wp.types.vector(16, int)


@wp.func_native(memory(256))
def word(k: int, value: int, write: bool) -> int:
    """Write or read a word of the block's shared memory."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __shared__ unsigned short held[1048];
#else
    static unsigned short held[1048];  // the threads of a block take turns on one core
#endif
    if (write)
        held[k] = value;
    return held[k];
""")
def held_path(k: int, value: int, write: bool) -> int:
    """Write or read an L that the block's shared memory holds: LINES x 2 x ROOM of them."""
    ...


# An `if` of Warp's takes a register, as long as the kernel runs, for each value set in it: these have their own.
@wp.func_native("""
    int lowest = 65535;
    if (wanted) {
        const float *path = array.data + rest + source;
        if (source >= 0 && source < disparities)
            lowest = wp::min(lowest, (wp::int32)path[0]);
        if (source > 0 && source <= disparities)
            lowest = wp::min(lowest, (wp::int32)path[-1] + small);
        if (source >= -1 && source < disparities - 1)
            lowest = wp::min(lowest, (wp::int32)path[1] + small);
    }
    return lowest;
""")
def rest_way(array: wp.array(dtype=float), rest: int, source: int, disparities: int, small: int, wanted: bool) -> int:
    """The cheapest way from the L that scratch holds: from that of `source` or, for `small` more, of one beside it."""
    ...


@wp.func_native("if (wanted) array.data[i] = wp::float32(value);")
def put_rest(array: wp.array(dtype=float), i: int, value: int, wanted: bool):
    """Write an L to scratch, or nothing."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __syncwarp();
#else
    WP_TILE_SYNC();
#endif
""")
def wait_for_line():
    """Wait until all threads of the line are here, and see what they wrote."""
    ...


@wp.func_native("return wanted ? array.data[i] : 0;")
def byte_at(array: wp.array(dtype=wp.uint8), i: int, wanted: bool) -> int:
    """Element i of an array whose elements lie side by side, or 0."""
    ...


@wp.func_native("return wanted ? array.data[i] : 0;")
def sum_at(array: wp.array(dtype=wp.uint16), i: int, wanted: bool) -> int:
    """Element i of an array whose elements lie side by side, or 0."""
    ...


@wp.func_native("if (wanted) array.data[i] = wp::uint16(value);")
def put_sum(array: wp.array(dtype=wp.uint16), i: int, value: int, wanted: bool):
    """Write element i of an array whose elements lie side by side, or nothing."""
    ...


@wp.func
def edge_between(guide: wp.array(dtype=wp.uint8), plane: int, p: int, q: int, edge: int) -> int:
    """Whether the guide changes by `edge` or more from pixel q to pixel p in a plane."""
    most = int(0)
    for k in range(3):
        most = wp.max(most, wp.abs(byte_at(guide, k * plane + p, True) - byte_at(guide, k * plane + q, True)))
    return wp.where(most >= edge, 1, 0)


@wp.func
def find_line(line: int, width: int, height: int, step_x: int, step_y: int) -> wp.vec3i:
    """A line's first column and row, and how many pixels it has.

    Lines start on the row that the step leads away from, then on the column.
    """
    on_row = step_y != 0 and line < width
    x = wp.where(on_row, line, wp.where(step_x > 0, 0, width - 1))
    y = wp.where(step_y == 0, line, line - width + wp.where(step_y > 0, 1, 0))
    if on_row:
        y = wp.where(step_y > 0, 0, height - 1)
    across = wp.where(step_x > 0, width - x, x + 1)
    down = wp.where(step_y > 0, height - y, y + 1)
    length = wp.where(step_x == 0, down, wp.where(step_y == 0, across, wp.min(across, down)))
    # Paths straight down or up have fewer lines than those that lean, and a block's last line may be none.
    lines = wp.where(step_y == 0, height, wp.where(step_x == 0, width, width + height - 1))
    return wp.vec3i(x, y, wp.where(line < lines, length, 0))


@wp.kernel(launch_bounds=(64, 8), grid_stride=False)
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
    block, thread = wp.tid()
    lane = thread % LANES
    own_line = thread // LANES
    line = block * LINES + own_line
    step_y = heading
    step_x = wp.where(heading == 0, 1 - 2 * stage, wp.where(stage == 2, -1, stage))
    place = find_line(line, width, height, step_x, step_y)
    length = place[2]
    longest = int(length)
    for k in range(LINES):
        other = find_line(block * LINES + k, width, height, step_x, step_y)
        longest = wp.max(longest, other[2])
    begin = place[1] * width + place[0]
    pixel_step = step_y * width + step_x
    plane = width * height
    chunks = (disparities + CHUNK - 1) // CHUNK
    total = length * chunks
    end = longest * chunks
    shift = row_slope * step_y
    adding = heading != 0 or stage != 0
    wide = disparities > HELD
    rest = 2 * line * disparities
    paths = own_line * 2 * ROOM
    lows = own_line * 2 * LANES
    edges = EDGES + own_line * 2 * LANES
    for k in range(lane, 2 * ROOM, LANES):
        held_path(paths + k, NOWHERE, True)
    # Whether there is an edge before each of the line's first pixels. The next ones follow when these are begun.
    at_edge = int(0)
    if lane > 0 and lane < length:
        at_edge = edge_between(guide, plane, begin + lane * pixel_step, begin + (lane - 1) * pixel_step, edge)
    word(edges + lane, at_edge, True)
    wait_for_line()

    cell = int(begin * disparities + lane)
    cell_ahead = int(cell)
    # From the last chunk of a pixel to the first one of the next.
    onward = pixel_step * disparities - (chunks - 1) * CHUNK
    chunk = int(0)
    chunk_ahead = int(0)
    pixel = int(0)
    edged = int(1)
    t = int(0)
    # The first pixel has none before it: nothing is added to its costs.
    cheapest = int(0)
    small = int(0)
    jump = int(0)
    low = int(FAR)
    costs = Asked()
    sums = Asked()
    ways = wp.vec4i()
    for slot in range(AHEAD):
        for k in range(EACH):
            wanted = slot < total and chunk_ahead * CHUNK + k * LANES + lane < disparities
            costs[EACH * slot + k] = byte_at(cost, cell_ahead + k * LANES, wanted)
            sums[EACH * slot + k] = sum_at(sums_out, cell_ahead + k * LANES, wanted and adding)
        chunk_ahead = wp.where(chunk_ahead + 1 == chunks, 0, chunk_ahead + 1)
        cell_ahead += wp.where(chunk_ahead == 0, onward, CHUNK)
    while t < end:
        if (pixel >> 5) + 1 >= edged:
            p = edged * LANES + lane
            if p < length:
                found = edge_between(guide, plane, begin + p * pixel_step, begin + (p - 1) * pixel_step, edge)
                word(edges + (edged & 1) * LANES + lane, found, True)
            edged += 1
        for slot in range(AHEAD):
            now = pixel & 1
            held = paths + now * ROOM + PAD
            before = paths + (1 - now) * ROOM + PAD
            rest_before = rest + (1 - now) * disparities
            for k in range(EACH):
                i = chunk * CHUNK + k * LANES + lane
                inside = t < total and i < disparities
                source = wp.clamp(i - shift, -2, disparities + 1)
                # Of what scratch holds nothing is found in shared memory, and the other way round.
                near = before + wp.where(wide, -2, source)
                far = wide and pixel > 0 and inside
                best = rest_way(scratch, rest_before, source, disparities, small, far)
                beside = wp.min(held_path(near - 1, 0, False), held_path(near + 1, 0, False))
                ways[k] = wp.min(wp.min(jump, best), wp.min(held_path(near, 0, False), beside + small)) - cheapest
            for k in range(EACH):
                i = chunk * CHUNK + k * LANES + lane
                inside = t < total and i < disparities
                own = costs[EACH * slot + k]
                path = wp.where(own == NO_MATCH, UNSEEN_COST, own) + ways[k]
                held_path(held + wp.where(wide, 0, i), path, inside and not wide)
                put_rest(scratch, rest + now * disparities + i, path, inside and wide)
                low = wp.min(low, wp.where(inside, path, FAR))
                unseen = heading == 0 and stage == 1 and own == NO_MATCH
                put_sum(sums_out, cell + k * LANES, wp.where(unseen, UNMATCHED, sums[EACH * slot + k] + path), inside)
                wanted = t + AHEAD < total and chunk_ahead * CHUNK + k * LANES + lane < disparities
                costs[EACH * slot + k] = byte_at(cost, cell_ahead + k * LANES, wanted)
                sums[EACH * slot + k] = sum_at(sums_out, cell_ahead + k * LANES, wanted and adding)
            chunk_ahead = wp.where(chunk_ahead + 1 == chunks, 0, chunk_ahead + 1)
            cell_ahead += wp.where(chunk_ahead == 0, onward, CHUNK)
            t += 1
            lowest = lowest_of_warp(low)
            word(lows + now * LANES + lane, lowest, True)
            # One barrier a step is enough, as the next pixel writes to the other half of everything.
            wait_for_line()
            for k in range(wp.where(warp_size() < LANES, 0, LANES), LANES):
                lowest = wp.min(lowest, word(lows + now * LANES + k, 0, False))
            last = chunk + 1 == chunks
            chunk = wp.where(last, 0, chunk + 1)
            cell += wp.where(last, onward, CHUNK)
            low = wp.where(last, FAR, low)
            pixel += wp.where(last, 1, 0)
            at_edge = word(edges + (pixel & 32) + (pixel & 31), 0, False)
            cheapest = wp.where(last, lowest, cheapest)
            small = wp.where(at_edge != 0, edge_small_penalty, small_penalty)
            large = wp.where(at_edge != 0, edge_large_penalty, large_penalty)
            jump = wp.where(pixel > 0, cheapest + large, 0)
