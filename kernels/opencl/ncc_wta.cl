// Correlation and winner takes all in one pass that never holds the volume: the form for GPUs.
//
// A work-group owns SPAN columns over a strip of rows, a work-item one disparity of each of them. Rows of both
// pictures lie in local memory; the box sums stay in registers and run down the strip: each row adds what the row
// that enters the window brings and the one that leaves it takes, summed along the row. The keys of a row pass
// through local memory, where the work-items look for the winners of both views. Longer ranges than GROUP are
// searched a chunk after another; what is known of each pixel waits in scratch.
#include "peaks.h"
#include "block_winners.h"

#define LARGEST_RADIUS 15

// Two whole numbers of 16 bits, first below second.
inline int pair(int first, int second) { return (first & 0xffff) | (second << 16); }

// first x first + second x second.
inline int pair_product(int a, int b) { return (int)(short)a * (int)(short)b + (a >> 16) * (b >> 16); }

// The highest level but that of disparity i.
inline int level_but(int4 four, int i, int bits) { return (key_index(four.x, bits) == i ? four.y : four.x) >> bits; }

// The peaks among disparities start .. end - 1, whose keys lie one `way` after another from keys on.
inline Peaks peaks_of(int4 four, __local const int *keys, int way, int start, int end, int bits)
{
    Peaks peaks = no_peaks();
    int at = key_index(four.x, bits);
    peaks.last = keys[way * (end - 1 - start)] >> bits;
    peaks.earlier = level_but(four, end - 1, bits);
    if (four.x == 0) return peaks;
    peaks.best = four.x >> bits;
    peaks.index = at;
    peaks.before = at > start ? keys[way * (at - 1 - start)] >> bits : 0;
    peaks.after = at < end - 1 ? keys[way * (at + 1 - start)] >> bits : 0;
    peaks.runner = runner_level(four, bits);
    return peaks;
}

// Peaks wait in scratch, a plane of it for each member; floats hold levels and indices, which have 23 bits at most.
inline void hold(__global float *at, long pixels, Peaks peaks)
{
    at[0] = (float)peaks.best;
    at[pixels] = (float)peaks.index;
    at[2 * pixels] = (float)peaks.before;
    at[3 * pixels] = (float)peaks.after;
    at[4 * pixels] = (float)peaks.runner;
    at[5 * pixels] = (float)peaks.last;
    at[6 * pixels] = (float)peaks.earlier;
}

// The peaks that wait in scratch and those of the next chunk, which begins at index start with the level first;
// later is the highest level of the chunk but that one.
inline Peaks joined(__global const float *at, long pixels, Peaks peaks, int start, int first, int later)
{
    int best = (int)at[0], beyond = best;
    if (peaks.best > best) {
        if (peaks.index == start) {
            peaks.before = (int)at[5 * pixels];
            beyond = (int)at[6 * pixels];
        }
        peaks.runner = peaks.runner > beyond ? peaks.runner : beyond;
    } else {
        int touches = (int)at[pixels] == start - 1, runner = (int)at[4 * pixels];
        beyond = touches ? later : peaks.best;
        peaks.best = best;
        peaks.index = (int)at[pixels];
        peaks.before = (int)at[2 * pixels];
        peaks.after = touches ? first : (int)at[3 * pixels];
        peaks.runner = runner > beyond ? runner : beyond;
    }
    peaks.earlier = peaks.earlier > best ? peaks.earlier : best;
    return peaks;
}

// What ncc_volume followed by wta computes, without the volume; other_out must come in as 0.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void ncc_wta(
    // In:
    __global const float *reference,
    __global const float *other,
    __global const float *reference_sum,
    __global const float *reference_inverse,
    __global const float *other_sum,
    __global const float *other_inverse,
    __global const uchar *validity,
    int width,
    int height,
    int smallest,
    int disparities,
    int radius,
    int direction,
    int subpixel,
    int rows,
    __global float *scratch,
    // Out:
    __global float *disparity_out,
    __global float *score_out,
    __global float *ratio_out,
    __global uchar *validity_out,
    __global int *other_out)
{
    // Grey levels of the rows that enter and leave the window; of the other view from the smallest u on.
    __local int ours[SPAN + 2 * LARGEST_RADIUS], theirs[GROUP + SPAN + 2 * LARGEST_RADIUS];
    __local float means[SPAN], inverses[SPAN], their_sums[GROUP + SPAN], their_inverses[GROUP + SPAN];
    __local int keys[SPAN * PITCH];
    __local int highest[GROUP], seconds[GROUP]; // of the keys that each work-item saw
    int lane = get_local_id(0), x0 = get_group_id(0) * SPAN, first = get_group_id(1) * rows;
    int last = first + rows < height ? first + rows : height;
    float count = (float)((2 * radius + 1) * (2 * radius + 1));
    int bits = index_bits(disparities);
    long pixels = (long)width * height;
    for (int k = lane; k < SPAN * PITCH; k += GROUP) keys[k] = 0;

    for (int start = 0; start < disparities; start += GROUP) {
        int end = start + GROUP < disparities ? start + GROUP : disparities;
        // Work-items of larger u come later.
        int i = start + (direction > 0 ? lane : GROUP - 1 - lane);
        int u0 = x0 + direction * (smallest + start) - (direction > 0 ? 0 : GROUP - 1);
        int box[SPAN];
        for (int s = 0; s < SPAN; s++) box[s] = 0;

        for (int y = first - 2 * radius; y < last; y++) {
            int row = y * width, entering = clamp_index(y + radius, height) * width;
            // The row that left the window when it moved down to y; before the first row nothing has.
            int leaving = clamp_index(y - radius - 1, height) * width;
            for (int k = lane; k < SPAN + 2 * radius; k += GROUP) {
                int x = clamp_index(x0 - radius + k, width);
                ours[k] = pair((int)reference[entering + x], y > first ? -(int)reference[leaving + x] : 0);
            }
            for (int k = lane; k < GROUP + SPAN + 2 * radius; k += GROUP) {
                int u = clamp_index(u0 - radius + k, width);
                theirs[k] = pair((int)other[entering + u], (int)other[leaving + u]);
            }
            if (y >= first) {
                if (lane < SPAN) {
                    int x = x0 + lane, inside = x < width;
                    means[lane] = inside ? reference_sum[row + x] / count : 0.0f;
                    // Scaled by a power of two, which changes no digit, so that scores come in levels.
                    inverses[lane] = inside ? reference_inverse[row + x] * score_scale(bits) : 0.0f;
                }
                for (int k = lane; k < GROUP + SPAN; k += GROUP) {
                    int u = u0 + k, inside = u >= 0 && u < width;
                    their_sums[k] = inside ? other_sum[row + u] : 0.0f;
                    their_inverses[k] = inside ? other_inverse[row + u] : 0.0f;
                }
            }
            barrier(CLK_LOCAL_MEM_FENCE);

            int change = 0; // of the box sum
            for (int k = 0; k < 2 * radius; k++) change += pair_product(ours[k], theirs[lane + k]);
#pragma unroll
            for (int s = 0; s < SPAN; s++) {
                change += pair_product(ours[s + 2 * radius], theirs[lane + s + 2 * radius]);
                box[s] += change;
                change -= pair_product(ours[s], theirs[lane + s]);
            }
            if (y < first) {
                // All must have read the rows before the next ones come.
                barrier(CLK_LOCAL_MEM_FENCE);
                continue;
            }
#pragma unroll
            for (int s = 0; s < SPAN; s++) {
                // This order of operations is the same in every form of the correlation, so that all agree.
                float score =
                    (((float)box[s] - means[s] * their_sums[lane + s]) * inverses[s]) * their_inverses[lane + s];
                int level = (int)score;
                keys[s * PITCH + lane] = level > 0 && i < disparities ? winner_key(level, i, bits) : 0;
            }
            barrier(CLK_LOCAL_MEM_FENCE);

            int high = 0, second = 0;
            search_column(keys, lane, &high, &second);
            highest[lane] = high;
            seconds[lane] = second;
            raise_winners(keys, lane, other_out + row, u0, width);
            barrier(CLK_LOCAL_MEM_FENCE);

            if (lane < SPAN && x0 + lane < width) {
                __global float *held = scratch + row + x0 + lane;
                __local const int *begin = keys + lane * PITCH + (direction > 0 ? 0 : GROUP - 1);
                int4 four = highest_four(highest + lane * CLASSES, seconds + lane * CLASSES);
                Peaks peaks = peaks_of(four, begin, direction, start, end, bits);
                if (start > 0)
                    peaks = joined(held, pixels, peaks, start, *begin >> bits, level_but(four, start, bits));
                hold(held, pixels, peaks);
            }
        }
    }

    // All that wait in scratch are there.
    barrier(CLK_GLOBAL_MEM_FENCE);
    for (int y = first + lane / SPAN; y < last; y += CLASSES) {
        int x = x0 + (lane & (SPAN - 1));
        if (x >= width) continue;
        long pixel = (long)y * width + x;
        __global const float *held = scratch + pixel;
        int best = (int)held[0], found = best > 0;
        score_out[pixel] = (float)best / score_scale(bits);
        disparity_out[pixel] = found ? peak_disparity((int)held[pixels], best, (int)held[2 * pixels],
                                                      (int)held[3 * pixels], smallest, subpixel)
                                     : NAN;
        ratio_out[pixel] = found ? held[4 * pixels] / (float)best : 0.0f;
        validity_out[pixel] = found || validity[pixel] ? validity[pixel] : OUT_OF_RANGE;
    }
}
