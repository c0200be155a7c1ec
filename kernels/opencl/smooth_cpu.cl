// Separable Gaussian prefilter: the form for CPUs.
//
// A work-item owns a band of rows and takes GROUP vectors of pixels at a time through the taps, whose sum stays in
// registers and is added up in the order of the other form.
#include "lanes.h"
#define GROUP 4
#define SPAN (GROUP * LANES)
#define TAPS 64 // that are added from one copy of a row

// Add `some` taps from number `first` on; those of one tap stand side by side at its place.
#define ADD(pointer, place, first, some) \
    for (int i = 0; i < (some); i++) { \
        lanes weight = (lanes)(weights[(first) + i]); \
        UNROLL for (int k = 0; k < GROUP; k++) sums[k] += weight * *(pointer)((place) + k * LANES); \
    }

// Weighted sum of 2 radius + 1 pixels along x (axis 0) or y (axis 1), the picture's edge repeated.
// The second pass (axis 1) rounds to whole grey levels, so that the correlation's sums stay exact.
__kernel void smooth(
    // In:
    __global const float *source,
    __global const float *weights,
    int width,
    int height,
    int radius,
    int axis,
    // Out:
    __global float *smoothed_out)
{
    int2 band = band_of_rows(height);
    int taps = 2 * radius + 1;
    float line[SPAN + TAPS + LANES];
    for (int y = band.x; y < band.y; y++) {
        __global float *row_out = smoothed_out + (long)y * width;
        for (int start = 0; start < width; start += SPAN) {
            lanes sums[GROUP];
            UNROLL for (int k = 0; k < GROUP; k++) sums[k] = (lanes)(0.0f);
            __global const float *row = source + (long)y * width;
            if (axis == 0 && start >= radius && start + SPAN + radius <= width) {
                ADD(__global const lanes *, row + start - radius + i, 0, taps)
            } else if (axis == 0) {
                for (int tap = 0; tap < taps; tap += TAPS) {
                    int some = tap + TAPS < taps ? TAPS : taps - tap;
                    load_line(line, row, start + tap - radius, SPAN + some, width, 1);
                    ADD(lanes *, line + i, tap, some)
                }
            } else if (start + SPAN <= width) {
                ADD(__global const lanes *, source + (long)clamp_index(y + i - radius, height) * width + start, 0, taps)
            } else {
                for (int tap = 0; tap < taps; tap++) {
                    load_line(
                        line, source + (long)clamp_index(y + tap - radius, height) * width, start, SPAN, width, 1);
                    ADD(lanes *, line, tap, 1)
                }
            }
            UNROLL for (int k = 0; k < GROUP; k++) {
                if (start + k * LANES >= width) continue;
                lanes sum = sums[k];
                if (axis == 1) sum = floor_lanes(sum + 0.5f);
                store_lanes(row_out, start + k * LANES, width, sum);
            }
        }
    }
}
