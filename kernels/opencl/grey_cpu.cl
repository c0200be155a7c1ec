// Luma of a picture, centred and in whole steps: the form for CPUs, whose work-items take a band of rows each.
#include "lanes.h"
#include "channels.h"

// Rec. 601 luma above black, times scale, rounded to whole grey levels 0..255, minus 128.
__kernel void grey(
    // In:
    __global const PIXEL *picture,
    int width,
    int height,
    int channels,
    float black,
    float scale,
    // Out:
    __global float *grey_out)
{
    int2 band = band_of_rows(height);
    long end = (long)band.y * width;
    for (long i = (long)band.x * width; i < end; i += WIDE) {
        wide luma;
        if (i + WIDE <= end) {
            luma = channel(picture, i, channels, 0);
            if (channels > 1)
                luma = 0.299f * luma + 0.587f * channel(picture, i, channels, 1)
                       + 0.114f * channel(picture, i, channels, 2);
        } else {
            for (int j = 0; i + j < end; j++) {
                __global const PIXEL *pixel = picture + (i + j) * channels;
                luma[j] = channels == 1 ? (float)pixel[0]
                                        : 0.299f * (float)pixel[0] + 0.587f * (float)pixel[1]
                                              + 0.114f * (float)pixel[2];
            }
        }
        // Whole numbers keep every sum of products of the correlation exact in float32.
        wide scaled = (luma - black) * scale;
        scaled = scaled > 0.0f ? scaled : 0.0f;
        scaled = (scaled < 255.0f ? scaled : 255.0f) + 0.5f;
        wide whole = __builtin_convertvector(__builtin_convertvector(scaled, int_wide), wide);
        whole = (scaled < whole ? whole - 1.0f : whole) - 128.0f;
        if (i + WIDE <= end) {
            *(__global wide *)(grey_out + i) = whole;
        } else {
            for (int j = 0; i + j < end; j++) grey_out[i + j] = whole[j];
        }
    }
}
