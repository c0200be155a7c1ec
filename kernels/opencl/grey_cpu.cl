// Luma of a picture, centred and in whole steps: the form for CPUs, whose work-items take a band of rows each.
#include "lanes.h"
#define WIDE 16 // pixels side by side
typedef float wide __attribute__((ext_vector_type(WIDE), aligned(4)));
typedef int int_wide __attribute__((ext_vector_type(WIDE), aligned(4)));
typedef PIXEL pixels __attribute__((ext_vector_type(WIDE), aligned(1)));

// WIDE pixels from place i on, their channels apart: red is channel 0.
inline wide channel(__global const PIXEL *picture, long i, int channels, int which)
{
    if (channels == 1) return __builtin_convertvector(*(__global const pixels *)(picture + i), wide);
    __global const PIXEL *first = picture + i * 3;
    pixels a = *(__global const pixels *)first, b = *(__global const pixels *)(first + WIDE);
    pixels c = *(__global const pixels *)(first + 2 * WIDE), mixed;
    if (which == 0) {
        mixed = __builtin_shufflevector(a, b, 0, 3, 6, 9, 12, 15, 18, 21, 24, 27, 30, 0, 0, 0, 0, 0);
        mixed = __builtin_shufflevector(mixed, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 17, 20, 23, 26, 29);
    } else if (which == 1) {
        mixed = __builtin_shufflevector(a, b, 1, 4, 7, 10, 13, 16, 19, 22, 25, 28, 31, 0, 0, 0, 0, 0);
        mixed = __builtin_shufflevector(mixed, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 18, 21, 24, 27, 30);
    } else {
        mixed = __builtin_shufflevector(a, b, 2, 5, 8, 11, 14, 17, 20, 23, 26, 29, 0, 0, 0, 0, 0, 0);
        mixed = __builtin_shufflevector(mixed, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 16, 19, 22, 25, 28, 31);
    }
    return __builtin_convertvector(mixed, wide);
}

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
