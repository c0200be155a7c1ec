// Refine disparities by correlating windows that lean with the surface.
#include "slant_pixel.h"

// Move each disparity to the peak of the NCC over step px around it, with windows that follow the surface.
// The window leans with the plane through the map around it; a slope of more than largest_slope px a pixel is
// a depth jump. The peak is a parabola's through three scores, at most step px from the plane. score_out is
// the NCC there; where it is under SURE noise would decide, and the plane stands.
__kernel void slant(
    // In:
    __global const float *reference,
    __global const float *other,
    __global const float *disparity,
    int width,
    int height,
    int radius,
    int direction,
    float step,
    float largest_slope,
    // Out:
    __global float *disparity_out,
    __global float *score_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    slant_pixel(
        reference, other, disparity, x, y, width, height, radius, direction, step, largest_slope, disparity_out,
        score_out);
}
