// Semi-global aggregation along the lines of one direction (Hirschmueller, PAMI 2008, section 2.3).
#define NO_MATCH 255
#define UNSEEN 254
#define UNSEEN_COST 20.0f
#define LARGEST_COST 62.0f

// What aggregate_cpu.cl says, with plain loops: scratch holds L of the last two pixels, 2 x D a line.
__kernel void aggregate(
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
    int line = get_global_id(0);
    if (line >= lines) return;
    // Lines start on the row that the step leads away from, then on the column.
    int on_row = step_y != 0 && line < width;
    int x = on_row ? line : step_x > 0 ? 0 : width - 1;
    int y = on_row ? (step_y > 0 ? 0 : height - 1) : step_y != 0 ? line - width + (step_y > 0 ? 1 : 0) : line;
    __global float *before = scratch + (long)line * 2 * disparities, *now = before + disparities;
    float cheapest = 0.0f, value = picture[y * width + x];
    int shift = row_slope * step_y, begun = 0;
    while (x >= 0 && x < width && y >= 0 && y < height) {
        int pixel = y * width + x;
        float change = picture[pixel] - value;
        float jump = cheapest + (change > edge || -change > edge ? edge_penalty : large_penalty);
        value = picture[pixel];
        float next_cheapest = 1.0e9f;
        for (int i = 0; i < disparities; i++) {
            long cell = (long)pixel * disparities + i;
            int own = cost[cell], from = i - shift;
            float path = own == UNSEEN ? UNSEEN_COST : own < LARGEST_COST ? (float)own : LARGEST_COST;
            if (begun) {
                float best = jump;
                if (from >= 0 && from < disparities && before[from] < best) best = before[from];
                if (from > 0 && from <= disparities && before[from - 1] + small_penalty < best)
                    best = before[from - 1] + small_penalty;
                if (from >= -1 && from < disparities - 1 && before[from + 1] + small_penalty < best)
                    best = before[from + 1] + small_penalty;
                path += best - cheapest;
            }
            now[i] = path;
            next_cheapest = path < next_cheapest ? path : next_cheapest;
            if (own != NO_MATCH) volume_out[cell] += (LARGEST_COST + large_penalty + 1.0f - path) * weight;
        }
        cheapest = next_cheapest;
        begun = 1;
        __global float *swap = before;
        before = now;
        now = swap;
        x += step_x;
        y += step_y;
    }
}
