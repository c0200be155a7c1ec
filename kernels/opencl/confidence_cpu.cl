// How far a disparity is to be trusted: the form for CPUs, whose work-items take a band of rows each.
#include "lanes.h"

// The score within 0..1, less the closer the runner-up comes to it, by weight; 0 where the pixel is not good.
__kernel void confidence(
    // In:
    __global const float *score,
    __global const float *ratio,
    __global const uchar *validity,
    int width,
    int height,
    float weight,
    // Out:
    __global float *confidence_out)
{
    int2 band = band_of_rows(height);
    for (int y = band.x; y < band.y; y++) {
        long place = (long)y * width;
        for (int x = 0; x < width; x += LANES) {
            lanes ours, runner_up;
            load_line((float *)&ours, score + place, x, 1, width, 1);
            load_line((float *)&runner_up, ratio + place, x, 1, width, 1);
            lanes trusted = ours * (1.0f - weight * runner_up);
            trusted = trusted < 1.0f ? trusted : (lanes)(1.0f);
            int_lanes good = load_reasons(validity + place, x, width) == 0 && trusted > 0.0f;
            store_lanes(confidence_out + place, x, width, good ? trusted : (lanes)(0.0f));
        }
    }
}
