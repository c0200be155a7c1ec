// Semi-global aggregation along the lines of one heading (Hirschmueller, PAMI 2008, section 2.3): the form for GPUs.
//
// A stage is one of the heading's paths. LANES work-items walk one line of it, side by side along the disparities, so
// that costs and sums are read and written as they lie; a work-group has two such lines. What a step takes from the
// device's memory is asked for AHEAD steps before, since a step is far shorter than the way there. A step is CHUNK
// disparities of a pixel. L of the last two pixels lies in local memory, or in scratch beyond HELD disparities.
#define NO_MATCH 255
#define UNSEEN_COST 96
#define UNMATCHED 60000
#define LINES 2 // kernels/geometry.py has the same,
#define HELD 256 // and this
#define LANES 32
#define GROUP (LINES * LANES)
#define EACH 4 // disparities of a work-item in a step
#define CHUNK (EACH * LANES)
#define AHEAD 4
#define PAD 3 // disparities out of range beside those that are held
#define NOWHERE 65535 // more than any L, whose sums have 16 bits

// The smallest of four numbers.
inline int lowest_of(int4 a)
{
    int left = a.x < a.y ? a.x : a.y, right = a.z < a.w ? a.z : a.w;
    return left < right ? left : right;
}

// Whether the guide changes by `edge` or more from pixel q to pixel p in a plane.
inline uchar edge_between(__global const uchar *guide, int plane, int p, int q, int edge)
{
    uchar found = 0;
    for (int k = 0; k < 3; k++) {
        int change = (int)guide[k * plane + p] - (int)guide[k * plane + q];
        found |= change >= edge || -change >= edge;
    }
    return found;
}

// Ask for the costs and sums of a step: `room` disparities from a cell on, of which every LANESth is ours.
inline void ask_for(
    __global const uchar *cost,
    __global const ushort *sums_out,
    long cell,
    int room,
    int adding,
    uchar *costs,
    ushort *sums)
{
#pragma unroll
    for (int k = 0; k < EACH; k++) {
        if (k * LANES < room) {
            costs[k] = cost[cell + k * LANES];
            if (adding) sums[k] = sums_out[cell + k * LANES];
        }
    }
}

// A line's first column and row, and how many pixels it has. Lines start on the row that the step leads away from, then
// on the column.
inline int4 find_line(int line, int width, int height, int step_x, int step_y)
{
    int on_row = step_y != 0 && line < width;
    int x = on_row ? line : step_x > 0 ? 0 : width - 1;
    int y = on_row ? (step_y > 0 ? 0 : height - 1) : step_y != 0 ? line - width + (step_y > 0 ? 1 : 0) : line;
    int across = step_x > 0 ? width - x : x + 1, down = step_y > 0 ? height - y : y + 1;
    int length = step_x == 0 ? down : step_y == 0 ? across : across < down ? across : down;
    // Paths straight down or up have fewer lines than those that lean, and a group's last line may be none.
    int lines = step_y == 0 ? height : step_x == 0 ? width : width + height - 1;
    if (line >= lines) length = 0;
    return (int4)(x, y, length, 0);
}

// Set sums_out (heading 0: along the rows, both ways) or add to it (1: the three paths from the row above; -1: from the
// row below) the L of each disparity along the heading's paths:
//   L(p, d) = C(p, d) + min(L(q, e), L(q, e +- 1) + small, min L(q) + large) - min L(q),  q = p - step,
//   e = d - row_slope step_y
// where the penalties are the lower ones of an edge where the guide changes by `edge` or more from q to p: depth jumps
// there. A surface whose disparity grows by row_slope a row pays nothing for that (Scharstein, Taniai, Sinha 2017).
// NO_MATCH costs UNSEEN_COST along a path, less than a false match, so that a surface goes on, and its sum is UNMATCHED.
// scratch holds L of the last two pixels, 2 x D a line.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void aggregate(
    // In:
    __global const uchar *cost,
    __global const uchar *guide,
    int width,
    int height,
    int disparities,
    int heading,
    int row_slope,
    int small_penalty,
    int large_penalty,
    int edge_small_penalty,
    int edge_large_penalty,
    int edge,
    int stage,
    __global float *scratch,
    // Out:
    __global ushort *sums_out)
{
    __local ushort all_held[LINES][2][HELD + 2 * PAD];
    __local int4 all_lows[LINES][2][LANES / 4];
    __local uchar all_edges[LINES][2][LANES];
    int lane = get_local_id(0) % LANES, own_line = get_local_id(0) / LANES;
    int line = get_group_id(0) * LINES + own_line;
    int step_y = heading, step_x = heading == 0 ? 1 - 2 * stage : stage == 2 ? -1 : stage;
    int4 place = find_line(line, width, height, step_x, step_y);
    int length = place.z, longest = place.z;
    for (int k = 0; k < LINES; k++) {
        int other = find_line(get_group_id(0) * LINES + k, width, height, step_x, step_y).z;
        longest = other > longest ? other : longest;
    }
    int begin = place.y * width + place.x, pixel_step = step_y * width + step_x, plane = width * height;
    int chunks = (disparities + CHUNK - 1) / CHUNK, total = length * chunks, end = longest * chunks;
    int shift = row_slope * step_y, adding = heading != 0 || stage != 0, wide = disparities > HELD;
    __global float *rest = scratch + (long)line * 2 * disparities;
    for (int k = lane; k < HELD + 2 * PAD; k += LANES) all_held[own_line][0][k] = all_held[own_line][1][k] = NOWHERE;
    // Whether there is an edge before each of the line's first pixels. The next ones follow when these are begun.
    all_edges[own_line][0][lane] =
        lane > 0 && lane < length &&
        edge_between(guide, plane, begin + lane * pixel_step, begin + (lane - 1) * pixel_step, edge);
    barrier(CLK_LOCAL_MEM_FENCE);

    long cell = (long)begin * disparities + lane, cell_ahead = cell;
    // From the last chunk of a pixel to the first one of the next.
    long onward = (long)pixel_step * disparities - (chunks - 1) * CHUNK;
    int chunk = 0, chunk_ahead = 0, pixel = 0, edged = 1, now = 0, t = 0;
    // The first pixel has none before it: nothing is added to its costs.
    int cheapest = 0, small = 0, jump = 0, low = 1 << 30;
    uchar costs[AHEAD][EACH];
    ushort sums[AHEAD][EACH];
#pragma unroll
    for (int slot = 0; slot < AHEAD; slot++) {
        if (slot < total) {
            int room = disparities - lane - chunk_ahead * CHUNK;
            ask_for(cost, sums_out, cell_ahead, room, adding, costs[slot], sums[slot]);
            chunk_ahead = chunk_ahead + 1 == chunks ? 0 : chunk_ahead + 1;
            cell_ahead += chunk_ahead == 0 ? onward : CHUNK;
        }
    }
    while (t < end) {
        if (pixel / LANES + 1 >= edged) {
            int p = edged * LANES + lane;
            all_edges[own_line][edged & 1][lane] =
                p < length && edge_between(guide, plane, begin + p * pixel_step, begin + (p - 1) * pixel_step, edge);
            edged++;
        }
#pragma unroll
        for (int slot = 0; slot < AHEAD; slot++) {
            __local ushort *held = all_held[own_line][now] + PAD;
            __local const ushort *before = all_held[own_line][now ^ 1] + PAD;
            __global const float *rest_before = rest + (now ^ 1) * disparities;
            if (t < total) {
#pragma unroll
                for (int k = 0; k < EACH; k++) {
                    int i = chunk * CHUNK + k * LANES + lane;
                    if (i < disparities) {
                        int source = i - shift, best = jump, same = NOWHERE, less = NOWHERE, more = NOWHERE;
                        source = source < -2 ? -2 : source > disparities + 1 ? disparities + 1 : source;
                        if (!wide) {
                            same = before[source];
                            less = before[source - 1];
                            more = before[source + 1];
                        } else if (pixel > 0) {
                            if (source >= 0 && source < disparities) same = (int)rest_before[source];
                            if (source > 0 && source <= disparities) less = (int)rest_before[source - 1];
                            if (source >= -1 && source < disparities - 1) more = (int)rest_before[source + 1];
                        }
                        less = (less < more ? less : more) + small;
                        best = same < best ? same : best;
                        best = less < best ? less : best;
                        int own = costs[slot][k];
                        int path = (own == NO_MATCH ? UNSEEN_COST : own) + best - cheapest;
                        if (wide) rest[now * disparities + i] = (float)path;
                        else held[i] = (ushort)path;
                        low = path < low ? path : low;
                        int sum = adding ? sums[slot][k] + path : path;
                        sums_out[cell + k * LANES] = heading == 0 && stage == 1 && own == NO_MATCH ? UNMATCHED : sum;
                    }
                }
                if (t + AHEAD < total) {
                    int room = disparities - lane - chunk_ahead * CHUNK;
                    ask_for(cost, sums_out, cell_ahead, room, adding, costs[slot], sums[slot]);
                    chunk_ahead = chunk_ahead + 1 == chunks ? 0 : chunk_ahead + 1;
                    cell_ahead += chunk_ahead == 0 ? onward : CHUNK;
                }
            }
            ((__local int *)all_lows[own_line][now])[lane] = low;
            // One barrier a step is enough, as the next pixel writes to the other half of everything.
            if (wide) barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);
            else barrier(CLK_LOCAL_MEM_FENCE);
            t++;
            chunk++;
            if (chunk == chunks) {
                int4 lows = all_lows[own_line][now][0];
                for (int k = 1; k < LANES / 4; k++) {
                    int4 more = all_lows[own_line][now][k];
                    lows.x = more.x < lows.x ? more.x : lows.x;
                    lows.y = more.y < lows.y ? more.y : lows.y;
                    lows.z = more.z < lows.z ? more.z : lows.z;
                    lows.w = more.w < lows.w ? more.w : lows.w;
                }
                cheapest = lowest_of(lows);
                low = 1 << 30;
                chunk = 0;
                pixel++;
                now ^= 1;
                cell += onward;
                int at_edge = all_edges[own_line][pixel / LANES & 1][pixel % LANES];
                small = at_edge ? edge_small_penalty : small_penalty;
                jump = cheapest + (at_edge ? edge_large_penalty : large_penalty);
            } else {
                cell += CHUNK;
            }
        }
    }
}
