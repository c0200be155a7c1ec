// Semi-global aggregation along the lines of one direction (Hirschmueller, PAMI 2008, section 2.3).
#define NO_MATCH 255
#define UNSEEN 254
#define UNSEEN_COST 20.0f
#define LARGEST_COST 62.0f

// Add to volume_out how much cheaper than the dearest path each disparity's path is, times weight.
// L(p, d) = C(p, d) + min(L(q, e), L(q, e +- 1) + small_penalty, min L(q) + P) - min L(q) with q = p - step and
// e = d - row_slope step_y: a surface whose disparity grows by row_slope a row pays nothing for that
// (Scharstein, Taniai, Sinha, 3DV 2017).
// P is large_penalty, or edge_penalty where the picture changes by more than edge grey levels from q to p:
// depth jumps at edges. A work-item walks one line; scratch holds L of the last two pixels, 2 x D a line. UNSEEN
// costs UNSEEN_COST, less than a false match, so that a surface goes on where only the other picture ends.
// NO_MATCH costs LARGEST_COST and adds nothing at its own pixel.
__kernel void aggregate(
    // In:
    __global const uchar *restrict cost,
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
    __global float *restrict volume_out)
{
    int line = get_global_id(0);
    if (line >= lines) return;
    // Lines start on the row that the step leads away from, then on the column.
    int on_row = step_y != 0 && line < width;
    int x = on_row ? line : step_x > 0 ? 0 : width - 1;
    int y = on_row ? (step_y > 0 ? 0 : height - 1) : step_y != 0 ? line - width + (step_y > 0 ? 1 : 0) : line;
    __global float *before = scratch + (long)line * 2 * disparities, *now = before + disparities;
    int last = disparities - 1;
    float cheapest = 0.0f, value = picture[y * width + x];
    for (int first = 1; x >= 0 && x < width && y >= 0 && y < height; first = 0, x += step_x, y += step_y) {
        int pixel = y * width + x;
        float change = picture[pixel] - value;
        float penalty = change > edge || -change > edge ? edge_penalty : large_penalty;
        value = picture[pixel];
        __global const uchar *restrict own = cost + (long)pixel * disparities;
        __global float *restrict sum = volume_out + (long)pixel * disparities;
        __global const float *restrict old = before;
        __global float *restrict new = now;
        float next_cheapest = 1.0e9f, jump = cheapest + penalty;
        for (int i = 0; i < disparities; i++) {
            float path = own[i] == UNSEEN ? UNSEEN_COST : own[i] < LARGEST_COST ? (float)own[i] : LARGEST_COST;
            if (!first) {
                int from = i - row_slope * step_y;
                float same = from >= 0 && from <= last ? old[from] : 1.0e9f;
                float down = (from > 0 && from <= last + 1 ? old[from - 1] : 1.0e9f) + small_penalty;
                float up = (from >= -1 && from < last ? old[from + 1] : 1.0e9f) + small_penalty;
                float best = same < jump ? same : jump;
                best = down < best ? down : best;
                best = up < best ? up : best;
                path += best - cheapest;
            }
            new[i] = path;
            next_cheapest = path < next_cheapest ? path : next_cheapest;
            float gain = (LARGEST_COST + large_penalty + 1.0f - path) * weight;
            sum[i] += own[i] != NO_MATCH ? gain : 0.0f;
        }
        cheapest = next_cheapest;
        __global float *swap = before;
        before = now;
        now = swap;
    }
}
