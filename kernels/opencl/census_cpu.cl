// Census transform: the form for CPUs. A work-item owns a band of rows and takes LANES pixels of a row at a time.
#include "lanes.h"

// Columns x to x + LANES - 1 of a row, its edge repeated.
inline lanes load_repeated(__global const float *row, int x, int width)
{
    if (x >= 0 && x + LANES <= width) return *(__global const lanes *)(row + x);
    lanes result;
    for (int k = 0; k < LANES; k++) result[k] = row[clamp_index(x + k, width)];
    return result;
}

// What census.cl computes.
__kernel void census(
    // In:
    __global const float *picture,
    int width,
    int height,
    int row_shift,
    // Out:
    __global int *bits_out)
{
    int2 rows = band_of_rows(height);
    for (int y = rows.x; y < rows.y; y++) {
        for (int start = 0; start < width; start += LANES) {
            // The last lanes of a row overlap with those before, where it holds so many.
            int x = start + LANES <= width || width < LANES ? start : width - LANES;
            lanes centre = load_repeated(picture + (long)y * width, x, width);
            int_lanes upper = 0, lower = 0;
            // The first pixel's bit is the highest one, and one place further up than in the end.
            uint bit = 1u << 31;
            for (int j = -3; j <= 0; j++) {
                __global const float *above = picture + (long)clamp_index(y + j, height) * width;
                __global const float *below = picture + (long)clamp_index(y - j, height) * width;
                for (int i = -4; i <= (j < 0 ? 4 : -1); i++) {
                    int column = i + row_shift * j;
                    int_lanes first = load_repeated(above, x + column, width) < centre;
                    int_lanes mirrored = load_repeated(below, x - column, width) < centre;
                    upper |= first & (int)bit;
                    lower |= mirrored & (int)bit;
                    bit >>= 1;
                }
            }
            upper = (upper >> 1) & 0x7fffffff;
            lower = (lower >> 1) & 0x7fffffff;
            __global int *bits = bits_out + ((long)y * width + x) * 2;
            for (int k = 0; k < LANES && x + k < width; k++) {
                bits[2 * k] = upper[k];
                bits[2 * k + 1] = lower[k];
            }
        }
    }
}
