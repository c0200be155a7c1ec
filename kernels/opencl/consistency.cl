// Left-right check: the other view's winner must point back.
#include "peaks.h"

#define OCCLUDED 4
#define MISMATCH 8

// Take a disparity away where the other view's winner differs from it by more than tolerance px.
// other holds winner_key. After Hirschmueller (PAMI 2008): a pixel is a mismatch if some disparity would have
// agreed with the other view, else it is occluded, as is one whose match lies outside of the other picture.
__kernel void consistency(
    // In:
    __global const float *disparity,
    __global const int *other,
    __global const uchar *validity,
    int width,
    int height,
    int smallest,
    int disparities,
    int direction,
    float tolerance,
    // Out:
    __global float *disparity_out,
    __global uchar *validity_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    int pixel = y * width + x;
    float value = disparity[pixel];
    disparity_out[pixel] = value;
    validity_out[pixel] = validity[pixel];
    if (value != value) return;
    int u = x + direction * (int)floor(value + 0.5f);
    if (u < -1 || u > width) {
        disparity_out[pixel] = NAN;
        validity_out[pixel] = OCCLUDED;
        return;
    }
    // The sub-pixel part may round to one pixel past the edge.
    int key = other[y * width + clamp_index(u, width)];
    int bits = index_bits(disparities);
    float difference = (float)(smallest + key_index(key, bits)) - value;
    if (key > 0 && difference <= tolerance && -difference <= tolerance) return;
    int verdict = OCCLUDED;
    for (int i = 0; i < disparities; i++) {
        int candidate = x + direction * (smallest + i);
        if (candidate < 0 || candidate >= width) continue;
        key = other[y * width + candidate];
        if (key > 0 && key_index(key, bits) == i) verdict = MISMATCH;
    }
    disparity_out[pixel] = NAN;
    validity_out[pixel] = verdict;
}
