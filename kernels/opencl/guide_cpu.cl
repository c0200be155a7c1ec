// Colour in levels that the camera's gain and offset do not change: the form for CPUs, whose work-items take a band of
// rows each.
#include "lanes.h"
#include "channels.h"
typedef uchar level_wide __attribute__((ext_vector_type(WIDE), aligned(1)));

// What guide.cl computes.
__kernel void guide(
    // In:
    __global const PIXEL *picture,
    __global const float *levels, // gain and offset of each plane
    int width,
    int height,
    int channels,
    // Out:
    __global uchar *guide_out)
{
    int2 band = band_of_rows(height);
    long end = (long)band.y * width, plane = (long)width * height;
    for (long i = (long)band.x * width; i < end; i += WIDE) {
        for (int c = 0; c < 3; c++) {
            __global uchar *to = guide_out + c * plane + i;
            float gain = levels[2 * c], offset = levels[2 * c + 1];
            if (i + WIDE <= end) {
                wide level = channel(picture, i, channels, c) * gain + offset + 0.5f;
                level = level > 0.0f ? level : 0.0f;
                level = level < 255.0f ? level : 255.0f;
                *(__global level_wide *)to =
                    __builtin_convertvector(__builtin_convertvector(level, int_wide), level_wide);
                continue;
            }
            for (int j = 0; i + j < end; j++) {
                float value = (float)picture[channels == 1 ? i + j : (i + j) * channels + c];
                float level = value * gain + offset + 0.5f;
                level = level > 0.0f ? level : 0.0f;
                to[j] = (uchar)(level < 255.0f ? level : 255.0f);
            }
        }
    }
}
