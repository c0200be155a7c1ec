// Fill holes along rows or columns.
#include "fill_line.h"

// Whether a place of a line belongs to a hole: inside of picture and mask, but without a value.
inline int empty(__global const float *values, __global const uchar *why, int at, long stride, int length)
{
    if (at < 0 || at >= length || why[at * stride] & MASKED) return 0;
    return values[at * stride] != values[at * stride];
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
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    int pixel = y * width + x;
    float value = disparity[pixel];
    uchar reason = validity[pixel];
    if (value != value && !(reason & MASKED)) {
        int at = axis ? y : x, length = axis ? height : width, stride = axis ? width : 1;
        __global const float *values = disparity + (pixel - at * stride);
        __global const uchar *why = validity + (pixel - at * stride);
        int left = 1, right = 1;
        while (left <= reach && empty(values, why, at - left, stride, length)) left++;
        while (right <= reach && empty(values, why, at + right, stride, length)) right++;
        if (left + right - 1 <= reach) {
            float before = end_of(values, why, at - left, -1, stride, length, near);
            float after = end_of(values, why, at + right, 1, stride, length, near);
            value = between(before, after, left, right, edges, tolerance);
            if (value == value) reason |= FILLED;
        }
    }
    disparity_out[pixel] = value;
    validity_out[pixel] = reason;
}
