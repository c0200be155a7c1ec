// Fill small holes along the row: the form for CPUs, whose work-items take a band of rows each and walk every hole
// once.
#include "lanes.h"
#define MASKED 16
#define FILLED 32

// Fill the pixels between the values at columns left and right of a row.
inline void bridge(__global float *row_out, __global uchar *why_out, int left, int right, float tolerance)
{
    // Counted from the lower end, so that a mirrored picture rounds alike.
    int rising = row_out[left] < row_out[right];
    float low = row_out[rising ? left : right], rise = row_out[rising ? right : left] - low;
    for (int x = left + 1; x < right; x++) {
        float share = (float)(rising ? x - left : right - x) / (float)(right - left);
        row_out[x] = rise <= tolerance ? low + rise * share : low;
        why_out[x] = FILLED;
    }
}

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
        int last = -1; // the last column so far that is in no hole
        for (int start = 0; start < width; start += LANES) {
            int length = start + LANES < width ? LANES : width - start, empty = 0;
            if (length == LANES) {
                lanes values = *(__global const lanes *)(row + start);
                int_lanes reasons = load_reasons(why, start, width);
                *(__global lanes *)(row_out + start) = values;
                store_reasons(why_out, start, width, reasons);
                empty = bits_of(values != values && reasons != MASKED);
            } else {
                for (int k = 0; k < length; k++) {
                    float value = row_out[start + k] = row[start + k];
                    int reason = why_out[start + k] = why[start + k];
                    empty |= (value != value && reason != MASKED) << k;
                }
            }
            // From change to change, of which most vectors have none.
            for (int k = 0; k < length;) {
                int in_hole = last < start + k - 1, rest = (in_hole ? ~empty : empty) >> k;
                int change = rest ? k + __builtin_ctz(rest) : length;
                if (change >= length) change = length;
                if (!in_hole) last = start + change - 1;
                if (change < length && in_hole) {
                    int hole = start + change - last - 1;
                    if (hole <= reach && last >= 0 && why[last] != MASKED && why[start + change] != MASKED)
                        bridge(row_out, why_out, last, start + change, tolerance);
                    last = start + change;
                }
                k = change + (change < length);
            }
        }
    }
}
