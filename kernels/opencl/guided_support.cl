// Drop disparities that those surroundings that look alike do not share.
#include "likeness.h"
#include "guided_support_pixel.h"

// Keep a value that at least share of the pixels around it (within reach, every step-th) have, to tolerance px.
// Pixels count by how much they look like the one in question in the guide, three planes of bytes; those without a
// value count a quarter, against it, and masked ones not at all.
// A surface may lean: the tolerance grows by slope px with each row or column of distance.
__kernel void guided_support(
    // In:
    __global const float *disparity,
    __global const uchar *validity,
    __global const uchar *guide,
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
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    support_pixel(disparity, validity, guide, x, y, width, height, reach, step, tolerance, slope, share, disparity_out,
                  validity_out);
}
