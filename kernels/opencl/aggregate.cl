// Semi-global aggregation along the lines of one heading (Hirschmueller, PAMI 2008, section 2.3): the form for GPUs.
//
// A stage is one of the heading's paths. A work-group walks one line of it, its work-items side by side along the
// disparities, so that costs and sums are read and written as they lie. L of the last two pixels lies in local memory,
// and in scratch beyond HELD disparities.
#define NO_MATCH 255
#define UNSEEN_COST 96
#define UNMATCHED 60000
#define GROUP 64 // kernels/geometry.py has the same,
#define HELD 256 // and this
#define EIGHTH (GROUP / 8)

// L of disparity i.
inline int path_at(__local const int *held, __global const float *rest, int i)
{
    return i < HELD ? held[i] : (int)rest[i];
}

// How much the guide changes from pixel q to pixel p in the plane where it does most.
inline int change_of(__global const uchar *guide, int plane, int p, int q)
{
    int most = 0;
    for (int k = 0; k < 3; k++) {
        int change = (int)guide[k * plane + p] - (int)guide[k * plane + q];
        change = change < 0 ? -change : change;
        most = change > most ? change : most;
    }
    return most;
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
    __local int held[2][HELD], lows[GROUP], lowest[EIGHTH];
    int lane = get_local_id(0), line = get_group_id(0);
    int step_y = heading, step_x = heading == 0 ? 1 - 2 * stage : stage == 2 ? -1 : stage;
    // Lines start on the row that the step leads away from, then on the column.
    int on_row = step_y != 0 && line < width;
    int x = on_row ? line : step_x > 0 ? 0 : width - 1;
    int y = on_row ? (step_y > 0 ? 0 : height - 1) : step_y != 0 ? line - width + (step_y > 0 ? 1 : 0) : line;
    __global float *rest = scratch + (long)line * 2 * disparities;
    int cheapest = 0, begun = 0, shift = row_slope * step_y;
    // Paths straight down or up have fewer lines.
    if (step_x == 0 && !on_row) return;
    for (int now = 0; x >= 0 && x < width && y >= 0 && y < height; now ^= 1) {
        __local const int *before = held[now ^ 1];
        __global const float *rest_before = rest + (now ^ 1) * disparities;
        int pixel = y * width + x, low = 1 << 30, small = 0, jump = 0;
        if (begun) {
            int at_edge = change_of(guide, width * height, pixel, pixel - step_y * width - step_x) >= edge;
            small = at_edge ? edge_small_penalty : small_penalty;
            jump = cheapest + (at_edge ? edge_large_penalty : large_penalty);
        }
        for (int i = lane; i < disparities; i += GROUP) {
            long cell = (long)pixel * disparities + i;
            int own = cost[cell], path = own == NO_MATCH ? UNSEEN_COST : own;
            if (begun) {
                int source = i - shift, best = jump, way;
                if (source >= 0 && source < disparities) {
                    way = path_at(before, rest_before, source);
                    best = way < best ? way : best;
                }
                if (source > 0 && source <= disparities) {
                    way = path_at(before, rest_before, source - 1) + small;
                    best = way < best ? way : best;
                }
                if (source >= -1 && source < disparities - 1) {
                    way = path_at(before, rest_before, source + 1) + small;
                    best = way < best ? way : best;
                }
                path += best - cheapest;
            }
            if (i < HELD) held[now][i] = path;
            else rest[now * disparities + i] = (float)path;
            low = path < low ? path : low;
            int sum = heading == 0 && stage == 0 ? path : sums_out[cell] + path;
            sums_out[cell] = heading == 0 && stage == 1 && own == NO_MATCH ? UNMATCHED : sum;
        }
        // The smallest L of the group, in two steps.
        lows[lane] = low;
        barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);
        if (lane < EIGHTH) {
            for (int k = lane; k < GROUP; k += EIGHTH) low = lows[k] < low ? lows[k] : low;
            lowest[lane] = low;
        }
        barrier(CLK_LOCAL_MEM_FENCE);
        cheapest = lowest[0];
        for (int k = 1; k < EIGHTH; k++) cheapest = lowest[k] < cheapest ? lowest[k] : cheapest;
        begun = 1;
        x += step_x;
        y += step_y;
    }
}
