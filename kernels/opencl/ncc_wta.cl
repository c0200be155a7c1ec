// Correlation and winner takes all in one pass that never holds the volume: the form for GPUs.
//
// A work-item owns one column over a strip of rows and walks its disparities; neighbouring work-items touch
// neighbouring addresses. The box sum of every disparity runs down the strip in scratch, D x W floats a strip.
#include "peaks.h"
#include "row_product.h"

// What ncc_volume followed by wta computes, without the volume; other_out must come in as 0.
__kernel void ncc_wta(
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
    int x = get_global_id(0), strip = get_global_id(1), first = strip * rows;
    if (x >= width || first >= height) return;
    float count = (float)((2 * radius + 1) * (2 * radius + 1));
    int bits = index_bits(disparities);
    int last = first + rows < height ? first + rows : height;
    __global float *boxes = scratch + (long)strip * disparities * width + x;
    for (int i = 0; i < disparities; i++) boxes[(long)i * width] = 0.0f;
    for (int y = first - 2 * radius; y < last; y++) {
        int entering = clamp_index(y + radius, height) * width;
        // The row that left the window when it moved down to y; before the first row nothing has.
        int leaving = clamp_index(y - radius - 1, height) * width;
        int pixel = y * width + x;
        Peaks peaks = no_peaks();
        for (int i = 0; i < disparities; i++) {
            int u = x + direction * (smallest + i), level = 0;
            if (u >= 0 && u < width) {
                float box = boxes[(long)i * width] + row_product(reference, other, entering, x, u, width, radius);
                if (y > first) box -= row_product(reference, other, leaving, x, u, width, radius);
                boxes[(long)i * width] = box;
                if (y < first) continue;
                // This order of operations is the same in every form of the correlation, so that all agree.
                float score = ((box - (reference_sum[pixel] / count) * other_sum[y * width + u])
                               * reference_inverse[pixel]) * other_inverse[y * width + u];
                level = score_level(score, bits);
                int key = winner_key(level, i, bits);
                // Most scores lose: reading first spares the atomic.
                if (level > 0 && key > other_out[y * width + u]) atomic_max(other_out + y * width + u, key);
            }
            see(&peaks, level, i);
        }
        if (y < first) continue;
        int found = peaks.best > 0;
        score_out[pixel] = (float)peaks.best / score_scale(bits);
        disparity_out[pixel] =
            found ? peak_disparity(peaks.index, peaks.best, peaks.before, peaks.after, smallest, subpixel) : NAN;
        ratio_out[pixel] = found ? (float)peaks.runner / (float)peaks.best : 0.0f;
        validity_out[pixel] = found || validity[pixel] ? validity[pixel] : OUT_OF_RANGE;
    }
}
