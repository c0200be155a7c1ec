// Zero-mean normalized cross-correlation of every pixel at every disparity.

#include "row_product.h"

// NCC of reference(x, y) with other(x + direction d, y), (H, W, D) with d fastest; 0 where there is none.
// direction is 1 for the right view as reference and -1 for the left one. A work-item is one disparity of
// one column over a strip of rows; the box sum runs down the strip.
__kernel void ncc_volume(
    // In:
    __global const float *reference,
    __global const float *other,
    __global const float *reference_sum,
    __global const float *reference_inverse,
    __global const float *other_sum,
    __global const float *other_inverse,
    int width,
    int height,
    int smallest,
    int disparities,
    int radius,
    int direction,
    int rows,
    // Out:
    __global float *volume_out)
{
    int i = get_global_id(0), x = get_global_id(1), first = get_global_id(2) * rows;
    if (i >= disparities || x >= width || first >= height) return;
    int u = x + direction * (smallest + i);
    float count = (float)((2 * radius + 1) * (2 * radius + 1));
    int last = first + rows < height ? first + rows : height;
    float box = 0.0f;
    for (int y = first - 2 * radius; y < last; y++) {
        box += row_product(reference, other, clamp_index(y + radius, height) * width, x, u, width, radius);
        if (y < first) continue;
        long pixel = (long)y * width + x;
        float score = 0.0f;
        if (u >= 0 && u < width)
            // This order of operations is the same in every form of the correlation, so that all agree.
            score = ((box - (reference_sum[pixel] / count) * other_sum[y * width + u]) * reference_inverse[pixel])
                    * other_inverse[y * width + u];
        volume_out[pixel * disparities + i] = score;
        box -= row_product(reference, other, clamp_index(y - radius, height) * width, x, u, width, radius);
    }
}
