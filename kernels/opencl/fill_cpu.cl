// Fill holes along rows or columns: the form for CPUs, whose work-items take a band of rows or of columns each and walk
// every hole once.
#include "lanes.h"
#include "fill_line.h"

// Fill the hole between places left and right of a line, if it is to be filled.
inline void bridge(
    __global const float *values,
    __global const uchar *why,
    __global float *values_out,
    __global uchar *why_out,
    int left,
    int right,
    long stride,
    int length,
    int reach,
    int near,
    int edges,
    float tolerance)
{
    if (right - left - 1 > reach) return;
    float before = end_of(values, why, left, -1, stride, length, near);
    float after = end_of(values, why, right, 1, stride, length, near);
    if (before != before && after != after) return;
    if ((before != before || after != after) && !edges) return;
    for (int at = left + 1; at < right; at++) {
        values_out[at * stride] = between(before, after, at - left, right - at, edges, tolerance);
        why_out[at * stride] = why[at * stride] | FILLED;
    }
}

// Copy the lanes of columns start on, as many as lie in the picture, and tell which of them lie in holes, a bit each.
inline int copy_lanes(
    __global const float *row, __global const uchar *why, __global float *row_out, __global uchar *why_out, int start,
    int width)
{
    if (start + LANES <= width) {
        lanes values = *(__global const lanes *)(row + start);
        int_lanes reasons = load_reasons(why, start, width);
        *(__global lanes *)(row_out + start) = values;
        store_reasons(why_out, start, width, reasons);
        return bits_of(values != values && (reasons & MASKED) == 0);
    }
    int empty = 0;
    for (int k = 0; start + k < width; k++) {
        float value = row_out[start + k] = row[start + k];
        int reason = why_out[start + k] = why[start + k];
        empty |= (value != value && !(reason & MASKED)) << k;
    }
    return empty;
}

// Give a value to holes of at most reach pixels in a row (axis 0) or column (axis 1); a filled pixel carries FILLED
// beside the reason it had. A hole's end is the smaller of the first two values in the `near` places next to it, or with
// near = 1 the value at its end: what lies at a jump is often wrong. Ends that agree to tolerance px are joined by a
// line; else the hole is background that the nearer surface hides from the other camera, and takes the smaller end.
// A hole that ends at the picture's or the mask's edge stays, or with edges != 0 takes the end that it has.
__kernel void fill(
    // In:
    __global const float *disparity,
    __global const uchar *validity,
    int width,
    int height,
    int axis,
    int reach,
    int near,
    int edges,
    float tolerance,
    // Out:
    __global float *disparity_out,
    __global uchar *validity_out)
{
    if (!axis) {
        int2 band = band_of_rows(height);
        for (int y = band.x; y < band.y; y++) {
            __global const float *row = disparity + (long)y * width;
            __global const uchar *why = validity + (long)y * width;
            __global float *row_out = disparity_out + (long)y * width;
            __global uchar *why_out = validity_out + (long)y * width;
            int last = -1; // the last column so far that is in no hole
            for (int start = 0; start < width; start += LANES) {
                int length = start + LANES < width ? LANES : width - start;
                int empty = copy_lanes(row, why, row_out, why_out, start, width);
                // From change to change, of which most vectors have none.
                for (int k = 0; k < length;) {
                    int in_hole = last < start + k - 1, rest = (in_hole ? ~empty : empty) >> k;
                    int change = rest ? k + __builtin_ctz(rest) : length;
                    if (change >= length) change = length;
                    if (!in_hole) last = start + change - 1;
                    if (change < length && in_hole) {
                        bridge(row, why, row_out, why_out, last, start + change, 1, width, reach, near, edges, tolerance);
                        last = start + change;
                    }
                    k = change + (change < length);
                }
            }
            if (last < width - 1) bridge(row, why, row_out, why_out, last, width, 1, width, reach, near, edges, tolerance);
        }
        return;
    }
    // An even share of the columns for each work-item, in whole vectors.
    int vectors = (width + LANES - 1) / LANES, share = (vectors - 1) / (int)get_global_size(0) + 1;
    int first = (int)get_global_id(0) * share * LANES;
    int end = first + share * LANES < width ? first + share * LANES : width;
    int last[BLOCK]; // of each column the last row so far that is in no hole
    for (int left = first; left < end; left += BLOCK) {
        int columns = left + BLOCK < end ? BLOCK : end - left;
        for (int k = 0; k < columns; k++) last[k] = -1;
        for (int y = 0; y <= height; y++) {
            for (int k = 0; k < columns; k += LANES) {
                long place = (long)y * width;
                int length = k + LANES < columns ? LANES : columns - k, empty = 0;
                if (y < height)
                    empty = copy_lanes(disparity + place, validity + place, disparity_out + place,
                                       validity_out + place, left + k, width);
                // Below the picture every hole ends.
                for (int j = k; j < k + length; j++) {
                    if (empty >> (j - k) & 1) continue;
                    int x = left + j;
                    if (last[j] < y - 1)
                        bridge(disparity + x, validity + x, disparity_out + x, validity_out + x, last[j], y, width,
                               height, reach, near, edges, tolerance);
                    last[j] = y;
                }
            }
        }
    }
}
