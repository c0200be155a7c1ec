// How likely a disparity of smooth paths is right: the form for CPUs, whose work-items take a band of rows each.
#include "lanes.h"

// About the probability that a disparity found by smooth paths is right to 1 px; 0 where the pixel is not good.
// It falls with the cube of the ratio of the lowest sum of costs to the runner-up's, by `doubt` where both are equal.
__kernel void certainty(
    // In:
    __global const float *ratio,
    __global const uchar *validity,
    int width,
    int height,
    float doubt,
    // Out:
    __global float *confidence_out)
{
    int2 band = band_of_rows(height);
    for (int y = band.x; y < band.y; y++) {
        long place = (long)y * width;
        for (int x = 0; x < width; x += LANES) {
            lanes rival;
            load_line((float *)&rival, ratio + place, x, 1, width, 1);
            rival = rival < 1.0f ? rival : (lanes)(1.0f);
            int_lanes good = load_reasons(validity + place, x, width) == 0;
            lanes trusted = 1.0f - doubt * (rival * rival * rival);
            store_lanes(confidence_out + place, x, width, good ? trusted : (lanes)(0.0f));
        }
    }
}
