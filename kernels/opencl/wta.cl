// Winner takes all over a volume of scores, for both views: the form for GPUs.
//
// A work-group owns SPAN columns of a row, a work-item one disparity of each of them, so that neighbouring work-items
// read neighbouring scores; the keys pass through local memory, where the work-items look for the winners.
#include "peaks.h"
#include "block_winners.h"

// Disparity (px), score and runner-up over best of every pixel; the other view's winner_key, which must come in as 0.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void wta(
    // In:
    __global const float *volume,
    __global const uchar *validity,
    int width,
    int height,
    int smallest,
    int disparities,
    int direction,
    int subpixel,
    // Out:
    __global float *disparity_out,
    __global float *score_out,
    __global float *ratio_out,
    __global uchar *validity_out,
    __global int *other_out)
{
    __local int keys[SPAN * PITCH], highest[GROUP], seconds[GROUP];
    int lane = get_local_id(0), x0 = get_group_id(0) * SPAN, y = get_group_id(1), high = 0, second = 0;
    int bits = index_bits(disparities);
    for (int k = lane; k < SPAN * PITCH; k += GROUP) keys[k] = 0;
    barrier(CLK_LOCAL_MEM_FENCE);

    for (int start = 0; start < disparities; start += GROUP) {
        // Work-items of larger u come later.
        int i = start + (direction > 0 ? lane : GROUP - 1 - lane);
        int u0 = x0 + direction * (smallest + start) - (direction > 0 ? 0 : GROUP - 1);
        __global const float *scores = volume + ((long)y * width + x0) * disparities + i;
        for (int s = 0; s < SPAN; s++) {
            int inside = x0 + s < width && i < disparities;
            int level = inside ? score_level(scores[(long)s * disparities], bits) : 0;
            keys[s * PITCH + lane] = level > 0 ? winner_key(level, i, bits) : 0;
        }
        barrier(CLK_LOCAL_MEM_FENCE);
        // Disparities of one class in all chunks are of one class still.
        search_column(keys, lane, &high, &second);
        raise_winners(keys, lane, other_out + y * width, u0, width);
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    highest[lane] = high;
    seconds[lane] = second;
    barrier(CLK_LOCAL_MEM_FENCE);

    if (lane >= SPAN || x0 + lane >= width) return;
    long pixel = (long)y * width + x0 + lane;
    int4 four = highest_four(highest + lane * CLASSES, seconds + lane * CLASSES);
    __global const float *scores = volume + pixel * disparities;
    int best = four.x >> bits, at = key_index(four.x, bits), found = best > 0;
    score_out[pixel] = (float)best / score_scale(bits);
    disparity_out[pixel] = NAN;
    if (found) {
        int before = at > 0 ? score_level(scores[at - 1], bits) : 0;
        int after = at < disparities - 1 ? score_level(scores[at + 1], bits) : 0;
        disparity_out[pixel] = peak_disparity(at, best, before, after, smallest, subpixel);
    }
    ratio_out[pixel] = found ? (float)runner_level(four, bits) / (float)best : 0.0f;
    validity_out[pixel] = found ? 0 : validity[pixel] ? validity[pixel] : OUT_OF_RANGE;
}
