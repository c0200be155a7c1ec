// Semi-global aggregation along the lines of one direction (Hirschmueller, PAMI 2008, section 2.3): the form for GPUs.
//
// A work-group walks one line, its work-items side by side along the disparities, so that costs and sums are read and
// written as they lie. L of the last two pixels lies in local memory, and in scratch beyond HELD disparities.
#define NO_MATCH 255
#define UNSEEN 254
#define UNSEEN_COST 20.0f
#define LARGEST_COST 62.0f
#define GROUP 64 // kernels/geometry.py has the same,
#define HELD 256 // and this
#define EIGHTH (GROUP / 8)

// L of disparity i.
inline float path_at(__local const float *held, __global const float *rest, int i)
{
    return i < HELD ? held[i] : rest[i];
}

// aggregate_cpu.cl says what is computed. scratch holds L of the last two pixels, 2 x D a line.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void aggregate(
    // In:
    __global const uchar *cost,
    __global const float *picture,
    int width,
    int height,
    int disparities,
    int step_x,
    int step_y,
    int row_slope,
    float small_penalty,
    float large_penalty,
    float edge_penalty,
    float edge,
    float weight,
    int lines,
    __global float *scratch,
    // Out:
    __global float *volume_out)
{
    __local float held[2][HELD], lows[GROUP], lowest[EIGHTH];
    int lane = get_local_id(0), line = get_group_id(0);
    // Lines start on the row that the step leads away from, then on the column.
    int on_row = step_y != 0 && line < width;
    int x = on_row ? line : step_x > 0 ? 0 : width - 1;
    int y = on_row ? (step_y > 0 ? 0 : height - 1) : step_y != 0 ? line - width + (step_y > 0 ? 1 : 0) : line;
    __global float *rest = scratch + (long)line * 2 * disparities;
    float cheapest = 0.0f, value = picture[y * width + x];
    int shift = row_slope * step_y, begun = 0;
    for (int now = 0; x >= 0 && x < width && y >= 0 && y < height; now ^= 1) {
        __local const float *before = held[now ^ 1];
        __global const float *rest_before = rest + (now ^ 1) * disparities;
        int pixel = y * width + x;
        float change = picture[pixel] - value;
        float jump = cheapest + (change > edge || -change > edge ? edge_penalty : large_penalty);
        value = picture[pixel];
        float low = 1.0e9f;
        for (int i = lane; i < disparities; i += GROUP) {
            long cell = (long)pixel * disparities + i;
            int own = cost[cell], from = i - shift;
            float path = own == UNSEEN ? UNSEEN_COST : own < LARGEST_COST ? (float)own : LARGEST_COST;
            if (begun) {
                float best = jump;
                if (from >= 0 && from < disparities) {
                    float same = path_at(before, rest_before, from);
                    best = same < best ? same : best;
                }
                if (from > 0 && from <= disparities) {
                    float down = path_at(before, rest_before, from - 1) + small_penalty;
                    best = down < best ? down : best;
                }
                if (from >= -1 && from < disparities - 1) {
                    float up = path_at(before, rest_before, from + 1) + small_penalty;
                    best = up < best ? up : best;
                }
                path += best - cheapest;
            }
            if (i < HELD)
                held[now][i] = path;
            else
                rest[now * disparities + i] = path;
            low = path < low ? path : low;
            if (own != NO_MATCH) volume_out[cell] += (LARGEST_COST + large_penalty + 1.0f - path) * weight;
        }
        lows[lane] = low;
        barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);
        if (lane < EIGHTH) {
            for (int k = lane + EIGHTH; k < GROUP; k += EIGHTH) low = lows[k] < low ? lows[k] : low;
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
