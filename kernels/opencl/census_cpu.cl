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
__kernel __attribute__((min_vector_width(512))) void census(
    // In:
    __global const float *picture,
    int width,
    int height,
    // Out:
    __global int *bits_out)
{
    int2 band = band_of_rows(height);
    for (int y = band.x; y < band.y; y++) {
        __global const float *rows[5];
        for (int j = 0; j < 5; j++) rows[j] = picture + (long)clamp_index(y + j - 2, height) * width;
        for (int start = 0; start < width; start += LANES) {
            // The last lanes of a row overlap with those before, where it holds so many.
            int x = start + LANES <= width || width < LANES ? start : width - LANES;
            int inside = x >= 2 && x + LANES + 2 <= width;
            lanes centre = load_repeated(rows[2], x, width);
            int_lanes bits = 0;
            UNROLL
            for (int k = 0; k < 25; k++) {
                if (k == 12) continue;
                __global const float *row = rows[k / 5];
                int column = x + k % 5 - 2;
                lanes near = inside ? *(__global const lanes *)(row + column) : load_repeated(row, column, width);
                bits |= (near < centre) & (1 << (k < 12 ? 23 - k : 24 - k));
            }
            __global int *to = bits_out + (long)y * width + x;
            if (x + LANES <= width)
                *(__global int_lanes *)to = bits;
            else
                for (int k = 0; x + k < width; k++) to[k] = bits[k];
        }
    }
}
