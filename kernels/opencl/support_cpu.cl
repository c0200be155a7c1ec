// Drop disparities that their surroundings do not share: the form for CPUs, whose work-items take a band of rows each.
#include "lanes.h"
#define MISMATCH 8
#define SPAN 64 // columns that the samples of one copy of a row are apart

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
    int half_way = reach / step, across = 2 * half_way + 1, most = SPAN / step + 1;
    float line[BLOCK + SPAN + LANES];
    lanes values[BLOCK / LANES];
    int_lanes agreeing[BLOCK / LANES];
    for (int y = band.x; y < band.y; y++) {
        for (int start = 0; start < width; start += BLOCK) {
            int columns = start + BLOCK < width ? BLOCK : width - start;
            long place = (long)y * width;
            load_line((float *)values, disparity + place, start, columns, width, 0);
            for (int k = 0; k < BLOCK / LANES; k++) agreeing[k] = (int_lanes)(0);
            for (int j = -half_way; j <= half_way; j++) {
                int row = y + j * step, down = j < 0 ? -j * step : j * step;
                if (row < 0 || row >= height) continue;
                for (int first = 0; first < across; first += most) {
                    int samples = first + most < across ? most : across - first;
                    load_line(line, disparity + (long)row * width, start + (first - half_way) * step,
                              columns + (samples - 1) * step, width, 0);
                    for (int i = 0; i < samples; i++) {
                        int by = (first + i - half_way) * step, away = by < 0 ? -by : by;
                        float allowed = tolerance + slope * (float)(down > away ? down : away);
                        for (int k = 0; k * LANES < columns; k++) {
                            lanes difference = *(lanes *)(line + i * step + k * LANES) - values[k];
                            // A comparison that holds is -1.
                            agreeing[k] -= difference <= allowed && -difference <= allowed;
                        }
                    }
                }
            }
            for (int k = 0; k * LANES < columns; k++) {
                int x = start + k * LANES;
                int_lanes has = values[k] == values[k];
                int_lanes alone = has && __builtin_convertvector(agreeing[k], lanes) < share * (float)(across * across);
                store_lanes(disparity_out + place, x, width, alone ? (lanes)(NAN) : values[k]);
                for (int j = 0; j < LANES && x + j < width; j++)
                    validity_out[place + x + j] = alone[j] ? MISMATCH : validity[place + x + j];
            }
        }
    }
}
