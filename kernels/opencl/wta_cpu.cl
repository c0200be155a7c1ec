// Winner takes all over a volume of scores, for both views: the form for CPUs.
#include "peaks.h"

// Disparity (px), score and runner-up over best of every pixel; the other view's winner_key.
// The work-item of pixel (x, y) also gathers the winner of the other view's pixel (x, y).
__kernel void wta(
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
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    long pixel = (long)y * width + x;
    int bits = index_bits(disparities);
    Peaks peaks = no_peaks();
    int other_key = 0;
    for (int i = 0; i < disparities; i++) {
        see(&peaks, score_level(volume[pixel * disparities + i], bits), i);
        int source = x - direction * (smallest + i);
        if (source >= 0 && source < width) {
            int level = score_level(volume[((long)y * width + source) * disparities + i], bits);
            int key = winner_key(level, i, bits);
            other_key = level > 0 && key > other_key ? key : other_key;
        }
    }
    int found = peaks.best > 0;
    other_out[pixel] = other_key;
    score_out[pixel] = (float)peaks.best / score_scale(bits);
    disparity_out[pixel] =
        found ? peak_disparity(peaks.index, peaks.best, peaks.before, peaks.after, smallest, subpixel) : NAN;
    ratio_out[pixel] = found ? (float)peaks.runner / (float)peaks.best : 0.0f;
    validity_out[pixel] = found ? 0 : validity[pixel] ? validity[pixel] : OUT_OF_RANGE;
}
