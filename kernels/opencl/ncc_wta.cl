// Correlation and winner takes all in one pass that never holds the volume: the form for GPUs.
//
// A work-group owns SPAN columns over a strip of rows, a work-item one disparity of each of them. Rows of both
// pictures lie in local memory; the box sums stay in registers and run down the strip: each row adds what the row
// that enters the window brings and the one that leaves it takes, summed along the row. The keys of a row pass
// through local memory, where the work-items look for the winners of both views. Longer ranges than GROUP are
// searched a chunk after another; what is known of each pixel waits in scratch meanwhile.
#include "peaks.h"

#define GROUP 64 // kernels/geometry.py has the same; with it 4 KiB of local memory suffice, and every device runs 64
#define SPAN 8
#define CLASSES (GROUP / SPAN) // work-items that share the search for the winner of a column
#define LARGEST_RADIUS 15
#define PITCH (SPAN + 1) // odd, so that neighbours' keys lie in different banks

// Two whole numbers of 16 bits, first below second.
inline int pair(int first, int second) { return (first & 0xffff) | (second << 16); }

// first x first + second x second.
inline int pair_product(int a, int b) { return (int)(short)a * (int)(short)b + (a >> 16) * (b >> 16); }

// The peaks of one column among disparities start .. end - 1, from their keys and the two highest of each class;
// later is the highest level but that of start.
inline Peaks peaks_of(__local const int *keys, __local const int *highest, __local const int *seconds, int start,
                      int end, int bits, int *later)
{
    int best = 0, runner = 0, behind = 0, ahead = 0;
    for (int k = 0; k < GROUP; k += SPAN) best = highest[k] > best ? highest[k] : best;
    int at = key_index(best, bits);
    for (int k = 0; k < GROUP; k += SPAN) {
        int high = highest[k], second = seconds[k], index = key_index(high, bits);
        int away = index >= at - 1 && index <= at + 1 ? second : high;
        int but_first = index == start ? second : high, but_last = index == end - 1 ? second : high;
        runner = away > runner ? away : runner;
        ahead = but_first > ahead ? but_first : ahead;
        behind = but_last > behind ? but_last : behind;
    }
    *later = ahead >> bits;
    Peaks peaks = no_peaks();
    peaks.last = keys[(end - start - 1) * PITCH] >> bits;
    peaks.earlier = behind >> bits;
    if (best == 0) return peaks;
    peaks.best = best >> bits;
    peaks.index = at;
    peaks.before = at > start ? keys[(at - start - 1) * PITCH] >> bits : 0;
    peaks.after = at < end - 1 ? keys[(at - start + 1) * PITCH] >> bits : 0;
    peaks.runner = runner >> bits;
    return peaks;
}

// Peaks that wait in scratch, a plane of it for each member; floats hold levels and indices, which have 23 bits.
inline Peaks held(__global const float *at, long pixels)
{
    Peaks peaks = {(int)at[0],          (int)at[pixels],     (int)at[2 * pixels], (int)at[3 * pixels],
                   (int)at[4 * pixels], (int)at[5 * pixels], (int)at[6 * pixels]};
    return peaks;
}

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
    __local float mean_x[SPAN], inverse_x[SPAN], sum_u[GROUP + SPAN], inverse_u[GROUP + SPAN];
    __local int keys[GROUP * PITCH];
    __local int highest[GROUP], seconds[GROUP]; // of the keys that each work-item saw
    int lane = get_local_id(0), x0 = get_group_id(0) * SPAN, first = get_group_id(1) * rows;
    int last = first + rows < height ? first + rows : height;
    // Work-items of larger u come later.
    int step = direction > 0 ? lane : GROUP - 1 - lane;
    float count = (float)((2 * radius + 1) * (2 * radius + 1));
    int bits = index_bits(disparities), mask = (1 << bits) - 1;
    long pixels = (long)width * height;

    for (int start = 0; start < disparities; start += GROUP) {
        int i = start + lane, end = start + GROUP < disparities ? start + GROUP : disparities;
        int u0 = direction > 0 ? x0 + smallest + start : x0 - smallest - start - (GROUP - 1);
        int box[SPAN];
        for (int s = 0; s < SPAN; s++) box[s] = 0;

        for (int y = first - 2 * radius; y < last; y++) {
            __global const float *entering = reference + clamp_index(y + radius, height) * width;
            __global const float *their_entering = other + clamp_index(y + radius, height) * width;
            // The row that left the window when it moved down to y; before the first row nothing has.
            int gone = clamp_index(y - radius - 1, height) * width;
            for (int k = lane; k < SPAN + 2 * radius; k += GROUP) {
                int x = clamp_index(x0 - radius + k, width);
                ours[k] = pair((int)entering[x], y > first ? -(int)reference[gone + x] : 0);
            }
            for (int k = lane; k < GROUP + SPAN + 2 * radius; k += GROUP) {
                int u = clamp_index(u0 - radius + k, width);
                theirs[k] = pair((int)their_entering[u], (int)other[gone + u]);
            }
            if (y >= first) {
                if (lane < SPAN) {
                    int pixel = y * width + x0 + lane, inside = x0 + lane < width;
                    mean_x[lane] = inside ? reference_sum[pixel] / count : 0.0f;
                    inverse_x[lane] = inside ? reference_inverse[pixel] : 0.0f;
                }
                for (int k = lane; k < GROUP + SPAN; k += GROUP) {
                    int pixel = y * width + u0 + k, inside = u0 + k >= 0 && u0 + k < width;
                    sum_u[k] = inside ? other_sum[pixel] : 0.0f;
                    inverse_u[k] = inside ? other_inverse[pixel] : 0.0f;
                }
            }
            barrier(CLK_LOCAL_MEM_FENCE);

            int change = 0;
            for (int k = 0; k < 2 * radius; k++) change += pair_product(ours[k], theirs[k + step]);
#pragma unroll
            for (int s = 0; s < SPAN; s++) {
                change += pair_product(ours[s + 2 * radius], theirs[s + 2 * radius + step]);
                box[s] += change;
                change -= pair_product(ours[s], theirs[s + step]);
            }
            if (y < first) {
                barrier(CLK_LOCAL_MEM_FENCE);
                continue;
            }
#pragma unroll
            for (int s = 0; s < SPAN; s++) {
                // This order of operations is the same in every form of the correlation, so that all agree.
                float score = (((float)box[s] - mean_x[s] * sum_u[s + step]) * inverse_x[s]) * inverse_u[s + step];
                int level = score_level(score, bits);
                keys[lane * PITCH + s] = level > 0 && i < disparities ? winner_key(level, i, bits) : 0;
            }
            barrier(CLK_LOCAL_MEM_FENCE);

            // Our winner: neighbouring disparities are in different classes, so that of the winner and its
            // neighbours none hides the runner-up.
            int high = 0, second = 0;
            for (int k = lane / SPAN; k < GROUP; k += CLASSES) {
                int key = keys[k * PITCH + (lane & (SPAN - 1))], lower = key < high ? key : high;
                second = lower > second ? lower : second;
                high = key > high ? key : high;
            }
            highest[lane] = high;
            seconds[lane] = second;
            // Their winner: the keys of one u lie on a diagonal; those of a diagonal that ends in this work-item and
            // of the one that begins where it ends are SPAN in all.
            int near = 0, far = 0;
            for (int s = 0; s < SPAN; s++) {
                int at = (lane - s) & (GROUP - 1);
                int key = keys[(direction > 0 ? at : GROUP - 1 - at) * PITCH + s];
                if (s <= lane)
                    near = key > near ? key : near;
                else
                    far = key > far ? key : far;
            }
            // A key is above 0 only where u is inside of the picture.
            if (near > 0) atomic_max(other_out + y * width + u0 + lane, near);
            if (far > 0) atomic_max(other_out + y * width + u0 + lane + GROUP, far);
            barrier(CLK_LOCAL_MEM_FENCE);

            if (lane < SPAN && x0 + lane < width) {
                int pixel = y * width + x0 + lane, later;
                Peaks peaks = peaks_of(keys + lane, highest + lane, seconds + lane, start, end, bits, &later);
                if (start > 0) peaks = joined(held(scratch + pixel, pixels), peaks, start, keys[lane] >> bits, later);
                if (end < disparities) {
                    hold(scratch + pixel, pixels, peaks);
                    continue;
                }
                int found = peaks.best > 0;
                score_out[pixel] = (float)peaks.best / score_scale(bits);
                disparity_out[pixel] =
                    found ? peak_disparity(peaks.index, peaks.best, peaks.before, peaks.after, smallest, subpixel) : NAN;
                ratio_out[pixel] = found ? (float)peaks.runner / (float)peaks.best : 0.0f;
                validity_out[pixel] = found || validity[pixel] ? validity[pixel] : OUT_OF_RANGE;
            }
        }
    }
}
