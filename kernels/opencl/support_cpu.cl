// Drop disparities that their surroundings do not share: the form for CPUs, whose work-items take a band of rows each.
#include "lanes.h"
#define MISMATCH 8
#define GROUP 4
#define SPAN (GROUP * LANES)
#define SPREAD 64 // columns that the samples of one copy of a row are apart

// Count which lanes agree with a row's samples, the first of which stands at `from`.
#define COUNT(pointer, from, first, samples) \
    for (int i = 0; i < (samples); i++) { \
        int by = ((first) + i - half_way) * step, away = by < 0 ? -by : by; \
        float allowed = tolerance + slope * (float)(down > away ? down : away); \
        UNROLL for (int k = 0; k < GROUP; k++) { \
            lanes difference = *(pointer)((from) + i * step + k * LANES) - values[k]; \
            agreeing[k] = magnitude(difference) <= allowed ? agreeing[k] + 1 : agreeing[k]; \
        } \
    }

// Keep a value that at least share of the pixels around it (within reach, every step-th) have, to tolerance px.
// A surface may lean: the tolerance grows by slope px with each row or column of distance.
// Pixels outside the picture or without a value do not share it.
__kernel void support(
    // In:
    __global const float *disparity,
    __global const uchar *validity,
    int width,
    int height,
    int reach,
    int step,
    float tolerance,
    float slope,
    float share,
    // Out:
    __global float *disparity_out,
    __global uchar *validity_out)
{
    int2 band = band_of_rows(height);
    int half_way = reach / step, across = 2 * half_way + 1, most = SPREAD / step + 1;
    float enough = share * (float)(across * across), line[SPAN + SPREAD + LANES];
    for (int y = band.x; y < band.y; y++) {
        long place = (long)y * width;
        for (int start = 0; start < width; start += SPAN) {
            lanes values[GROUP];
            int_lanes agreeing[GROUP];
            load_line(line, disparity + place, start, SPAN, width, 0);
            UNROLL for (int k = 0; k < GROUP; k++) values[k] = *(lanes *)(line + k * LANES);
            UNROLL for (int k = 0; k < GROUP; k++) agreeing[k] = (int_lanes)(0);
            for (int j = -half_way; j <= half_way; j++) {
                int row = y + j * step, down = j < 0 ? -j * step : j * step;
                if (row < 0 || row >= height) continue;
                __global const float *from = disparity + (long)row * width;
                if (start >= reach && start + SPAN + reach <= width) {
                    COUNT(__global const lanes *, from + start - half_way * step, 0, across)
                    continue;
                }
                for (int first = 0; first < across; first += most) {
                    int samples = first + most < across ? most : across - first, x = start + (first - half_way) * step;
                    load_line(line, from, x, SPAN + (samples - 1) * step, width, 0);
                    COUNT(lanes *, line, first, samples)
                }
            }
            UNROLL for (int k = 0; k < GROUP; k++) {
                int x = start + k * LANES;
                if (x >= width) continue;
                int_lanes alone = values[k] == values[k] && __builtin_convertvector(agreeing[k], lanes) < enough;
                store_lanes(disparity_out + place, x, width, alone ? (lanes)(NAN) : values[k]);
                store_reasons(validity_out + place, x, width,
                              alone ? (int_lanes)(MISMATCH) : load_reasons(validity + place, x, width));
            }
        }
    }
}
