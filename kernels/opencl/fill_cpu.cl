// Fill small holes along the row: the form for CPUs, whose work-items take a band of rows each and walk every hole once.
#include "lanes.h"
#define MASKED 16
#define FILLED 32

// Give a value to holes of at most reach pixels in a row; a filled pixel carries FILLED.
// Ends that agree to tolerance px are joined by a line; else the hole is background that the nearer surface
// hides from the other camera, and takes the smaller disparity. A hole that ends at the picture's or the
// mask's edge stays: nothing tells what is there.
__kernel void fill(
    // In:
    __global const float *disparity,
    __global const uchar *validity,
    int width,
    int height,
    int reach,
    float tolerance,
    // Out:
    __global float *disparity_out,
    __global uchar *validity_out)
{
    int2 band = band_of_rows(height);
    for (int y = band.x; y < band.y; y++) {
        __global const float *row = disparity + (long)y * width;
        __global const uchar *why = validity + (long)y * width;
        __global float *row_out = disparity_out + (long)y * width;
        __global uchar *why_out = validity_out + (long)y * width;
        for (int x = 0; x < width; x++) {
            row_out[x] = row[x];
            why_out[x] = why[x];
        }
        // The last pixel that was no hole's, and whether it can be the end of one.
        int last = -1, bounds = 0;
        for (int x = 0; x < width; x++) {
            int missing = row[x] != row[x];
            if (missing && why[x] != MASKED) continue;
            int hole = x - 1 - last;
            if (hole > 0 && hole <= reach && bounds && !missing && why[x] != MASKED) {
                // Counted from the lower end, so that a mirrored picture rounds alike.
                int rising = row[last] < row[x];
                float value = rising ? row[last] : row[x], rise = (rising ? row[x] : row[last]) - value;
                for (int k = 1; k <= hole; k++) {
                    float share = (float)(rising ? k : hole + 1 - k) / (float)(hole + 1);
                    row_out[last + k] = rise <= tolerance ? value + rise * share : value;
                    why_out[last + k] = FILLED;
                }
            }
            last = x;
            bounds = !missing && why[x] != MASKED;
        }
    }
}
