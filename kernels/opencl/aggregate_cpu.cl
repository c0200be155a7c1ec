// Semi-global aggregation along the lines of one direction: the form for CPUs.
//
// A work-item walks a few neighbouring lines side by side, so that each row of its walk reads and writes one long
// piece of memory, which is asked for some steps before. Every vector holds LANES disparities of one pixel; its
// neighbours one disparity away are shifted together from vectors that lie as they were stored, since a processor
// cannot take a vector from two stores that are still under way.
#include "lanes.h"
#define NO_MATCH 255.0f
#define UNSEEN 254.0f
#define UNSEEN_COST 20.0f
#define LARGEST_COST 62.0f
#define SIDE_BY_SIDE 8 // lines; kernels/geometry.py computes the same
#define STEPS_AHEAD 8
#define WALL 1.0e9f
#define INLINE inline __attribute__((always_inline))

#if LANES == 16
#define SHIFT(a, b, n) __builtin_shufflevector(a, b, n, n + 1, n + 2, n + 3, n + 4, n + 5, n + 6, n + 7, \
    n + 8, n + 9, n + 10, n + 11, n + 12, n + 13, n + 14, n + 15)
#else
#define SHIFT(a, b, n) __builtin_shufflevector(a, b, n, n + 1, n + 2, n + 3, n + 4, n + 5, n + 6, n + 7)
#endif

// What is the same for all disparities of a pixel.
typedef struct {
    float small_penalty, jump, cheapest, dearest, weight;
} Step;

// Cost of each path that arrives at LANES disparities; from the pixel before, the paths one disparity back, at the
// same one and one ahead.
INLINE lanes arrive(Step step, lanes paid, lanes back, lanes same, lanes ahead)
{
    lanes best = same < step.jump ? same : step.jump;
    lanes down = back + step.small_penalty, up = ahead + step.small_penalty;
    best = down < best ? down : best;
    best = up < best ? up : best;
    lanes capped = paid < LARGEST_COST ? paid : LARGEST_COST;
    return (paid == UNSEEN ? UNSEEN_COST : capped) + (best - step.cheapest);
}

INLINE lanes savings(Step step, lanes paid, lanes path)
{
    lanes gain = (step.dearest - path) * step.weight;
    return paid == NO_MATCH ? 0.0f : gain;
}

INLINE float least(lanes v)
{
#ifdef __AVX2__
#if LANES == 16
    float8 eight = v.lo < v.hi ? v.lo : v.hi;
#else
    float8 eight = v;
#endif
    float4 four = eight.lo < eight.hi ? eight.lo : eight.hi;
    float2 two = four.lo < four.hi ? four.lo : four.hi;
    return two.x < two.y ? two.x : two.y;
#else
    float result = v[0];
    for (int k = 1; k < LANES; k++) result = v[k] < result ? v[k] : result;
    return result;
#endif
}

// One pixel: its paths from those of the pixel before; the cheapest one. Paths have walls of LANES on either side.
INLINE float walk_pixel(
    Step step, __global const uchar *own, __global const float *old, __global float *now, __global float *sum,
    int disparities, int shift)
{
    lanes low = WALL, before = *(__global const lanes *)(old - LANES), here = *(__global const lanes *)old;
    for (int i = 0; i < disparities; i += LANES) {
        lanes after = *(__global const lanes *)(old + i + LANES), back, same, ahead;
        if (shift == 0) {
            back = SHIFT(before, here, LANES - 1);
            same = here;
            ahead = SHIFT(here, after, 1);
        } else if (shift == 1) {
            back = SHIFT(before, here, LANES - 2);
            same = SHIFT(before, here, LANES - 1);
            ahead = here;
        } else if (shift == -1) {
            back = here;
            same = SHIFT(here, after, 1);
            ahead = SHIFT(here, after, 2);
        } else {
            back = *(__global const lanes *)(old + i - shift - 1);
            same = *(__global const lanes *)(old + i - shift);
            ahead = *(__global const lanes *)(old + i - shift + 1);
        }
        before = here;
        here = after;
        lanes path;
        if (i + LANES <= disparities) {
            lanes paid = __builtin_convertvector(*(__global const uchar_lanes *)(own + i), lanes);
            path = arrive(step, paid, back, same, ahead);
            *(__global lanes *)(sum + i) += savings(step, paid, path);
        } else {
            lanes paid = NO_MATCH;
            for (int k = 0; i + k < disparities; k++) paid[k] = (float)own[i + k];
            path = arrive(step, paid, back, same, ahead);
            lanes gain = savings(step, paid, path);
            for (int k = 0; i + k < disparities; k++) sum[i + k] += gain[k];
            path = lane_numbers() + i < disparities ? path : WALL;
        }
        *(__global lanes *)(now + i) = path;
        low = path < low ? path : low;
    }
    return least(low);
}

// Ask for memory that will be needed soon: it lies apart from what was needed last, so that no processor guesses it.
INLINE void fetch(__global const void *from, int bytes)
{
#ifdef __AVX2__
    for (int i = 0; i < bytes; i += 64) __builtin_prefetch((const void *)((size_t)from + i));
#endif
}

// What aggregate.cl computes.
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
    // Lines along a row are long pieces of memory by themselves.
    int together = step_y == 0 ? 1 : SIDE_BY_SIDE;
    int first = (int)get_global_id(0) * together;
    if (first >= lines) return;
    together = first + together <= lines ? together : lines - first;
    int padded = (disparities + LANES - 1) / LANES * LANES, held = padded + 2 * LANES;
    __global float *paths = scratch + (long)first * 2 * held + LANES;
    float cheapest[SIDE_BY_SIDE], value[SIDE_BY_SIDE];
    Step step = {small_penalty, 0.0f, 0.0f, LARGEST_COST + large_penalty + 1.0f, weight};
    int steps = step_y == 0 ? width : height, lean = step_x * step_y;
    int shift = row_slope * step_y, backwards = step_y == 0 ? step_x < 0 : step_y < 0;
    long soon = STEPS_AHEAD * ((long)step_y * width + step_x);
    for (int s = 0; s < steps; s++) {
        int at = backwards ? steps - 1 - s : s;
        // Where line 0 is; leaning lines are counted from the one furthest left.
        int origin = step_y == 0 ? at : lean * at - (lean > 0 ? height - 1 : 0);
        for (int k = 0; k < together; k++) {
            int x = step_y == 0 ? origin : origin + first + k, y = step_y == 0 ? first : at;
            if (x < 0 || x >= width) continue;
            long pixel = (long)y * width + x;
            __global float *old = paths + (2 * k + (s & 1)) * held, *now = paths + (2 * k + 1 - (s & 1)) * held;
            if (s == 0 || x - step_x < 0 || x - step_x >= width) {
                // A path that comes from nowhere costs nothing, so that the first pixel pays its own cost alone.
                for (int i = -LANES; i < padded + LANES; i += LANES) *(__global lanes *)(old + i) = 0.0f;
                cheapest[k] = 0.0f;
                value[k] = picture[pixel];
            }
            // Later ones see walls at either end of the range, which spares the loop every test.
            *(__global lanes *)(now - LANES) = *(__global lanes *)(now + padded) = WALL;
            if (pixel + soon >= 0 && pixel + soon < (long)height * width) {
                fetch(cost + (pixel + soon) * disparities, disparities);
                fetch(volume_out + (pixel + soon) * disparities, 4 * disparities);
            }
            float change = picture[pixel] - value[k];
            step.cheapest = cheapest[k];
            step.jump = cheapest[k] + (change > edge || -change > edge ? edge_penalty : large_penalty);
            value[k] = picture[pixel];
            __global const uchar *own = cost + pixel * disparities;
            __global float *sum = volume_out + pixel * disparities;
            if (shift == 0)
                cheapest[k] = walk_pixel(step, own, old, now, sum, disparities, 0);
            else if (shift == 1)
                cheapest[k] = walk_pixel(step, own, old, now, sum, disparities, 1);
            else if (shift == -1)
                cheapest[k] = walk_pixel(step, own, old, now, sum, disparities, -1);
            else
                cheapest[k] = walk_pixel(step, own, old, now, sum, disparities, shift);
        }
    }
}
