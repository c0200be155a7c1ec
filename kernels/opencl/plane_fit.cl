// Move disparities onto the plane through those surroundings that look alike.
#include "likeness.h"
#include "plane_fit_pixel.h"

// Least squares plane through the pixels around each (within reach, every step-th), in two rounds: through those
// within tolerance px of the pixel's own disparity, where the tolerance grows by slope px with each row or column of
// distance, then through those within tolerance of that plane. Neighbours weigh by how near they are to it
// (Tukey 1977) and by how much they look like the pixel in the guide, three planes of bytes; masked ones not at all.
// A slope of more than largest_slope px a pixel is a depth jump. No disparity moves by more than tolerance.
__kernel void plane_fit(
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
    float largest_slope,
    // Out:
    __global float *disparity_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    fit_pixel(disparity, validity, guide, x, y, width, height, reach, step, tolerance, slope, largest_slope,
              disparity_out);
}
