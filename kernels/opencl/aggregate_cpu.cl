// Semi-global aggregation along the lines of one direction (Hirschmueller, PAMI 2008, section 2.3).
#define NO_MATCH 255.0f
#define UNSEEN 254.0f
#define UNSEEN_COST 20.0f
#define LARGEST_COST 62.0f
#define PAD 4 // slopes of up to 3 px a row; kernels/geometry.py computes the same
#define WALL 1.0e9f
#define LANES 8
typedef float lanes __attribute__((ext_vector_type(LANES), aligned(4)));
typedef uchar uchar_lanes __attribute__((ext_vector_type(LANES), aligned(1)));

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
    __global float *before = scratch + (long)line * 2 * (disparities + 2 * PAD) + PAD;
    __global float *now = before + disparities + 2 * PAD;
    // A path that comes from nowhere costs nothing, so that the first pixel pays its own cost alone; later ones
    // see walls at either end of the range, which spares the loop every test.
    for (int i = -PAD; i < disparities + PAD; i++) before[i] = 0.0f;
    for (int i = 0; i < PAD; i++) now[-1 - i] = now[disparities + i] = WALL;
    float cheapest = 0.0f, value = picture[y * width + x];
    int shift = row_slope * step_y;
    while (x >= 0 && x < width && y >= 0 && y < height) {
        int pixel = y * width + x;
        float change = picture[pixel] - value;
        float jump = cheapest + (change > edge || -change > edge ? edge_penalty : large_penalty);
        value = picture[pixel];
        __global const uchar *own = cost + (long)pixel * disparities;
        __global float *sum = volume_out + (long)pixel * disparities;
        __global const float *old = before - shift;
        lanes low = (lanes)(WALL);
        int i = 0;
        // Lanes by hand: a compiler may not reorder a minimum of floats, and so leaves the loop scalar.
        for (; i + LANES <= disparities; i += LANES) {
            lanes paid = __builtin_convertvector(*(__global const uchar_lanes *)(own + i), lanes);
            lanes same = *(__global const lanes *)(old + i);
            lanes down = *(__global const lanes *)(old + i - 1) + small_penalty;
            lanes up = *(__global const lanes *)(old + i + 1) + small_penalty;
            lanes best = same < jump ? same : jump;
            best = down < best ? down : best;
            best = up < best ? up : best;
            lanes capped = paid < LARGEST_COST ? paid : LARGEST_COST;
            lanes path = (paid == UNSEEN ? UNSEEN_COST : capped) + (best - cheapest);
            *(__global lanes *)(now + i) = path;
            low = path < low ? path : low;
            lanes gain = (LARGEST_COST + large_penalty + 1.0f - path) * weight;
            *(__global lanes *)(sum + i) += paid == NO_MATCH ? 0.0f : gain;
        }
        float next_cheapest = WALL;
        for (int k = 0; k < LANES; k++) next_cheapest = low[k] < next_cheapest ? low[k] : next_cheapest;
        for (; i < disparities; i++) {
            float paid = (float)own[i];
            float down = old[i - 1] + small_penalty, up = old[i + 1] + small_penalty;
            float best = old[i] < jump ? old[i] : jump;
            best = down < best ? down : best;
            best = up < best ? up : best;
            float capped = paid < LARGEST_COST ? paid : LARGEST_COST;
            float path = (paid == UNSEEN ? UNSEEN_COST : capped) + (best - cheapest);
            now[i] = path;
            next_cheapest = path < next_cheapest ? path : next_cheapest;
            sum[i] += paid == NO_MATCH ? 0.0f : (LARGEST_COST + large_penalty + 1.0f - path) * weight;
        }
        cheapest = next_cheapest;
        __global float *swap = before;
        before = now;
        now = swap;
        for (int i = 0; i < PAD; i++) now[-1 - i] = now[disparities + i] = WALL;
        x += step_x;
        y += step_y;
    }
}
