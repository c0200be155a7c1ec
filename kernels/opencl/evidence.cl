// Step from nearly right disparities to where both pictures fit, and how much they say about it.
#include "likeness.h"
#include "evidence_pixel.h"

// One damped Gauss-Newton step (Lucas and Kanade 1981) over the (2 radius + 1)^2 pixels around, whose disparities lean
// by along_x and along_y px a pixel, with the mean difference of grey levels removed. The gradient is the mean of
// both pictures' central differences. Samples weigh by how much they look like the pixel in the guide, three planes
// of bytes, where `weighted`, else all the same; those without all their neighbours in both rows do not count.
// residual_out is the variance of the difference after the step; information_out, the inverse of the step's variance,
// the energy of the gradients over that variance and twice `noise`, which is more than 0. The step is at most
// largest_step px, and shrinks by information / (information + keep). Where x or y is no multiple of stride, where
// there is no disparity or where the weights sum up to less than EVIDENCE_ENOUGH, the disparity stays, with
// information 0 and residual UNKNOWN.
__kernel void evidence(
    // In:
    __global const float *reference,
    __global const float *other,
    __global const float *disparity,
    __global const float *along_x,
    __global const float *along_y,
    __global const uchar *guide,
    int width,
    int height,
    int radius,
    int stride,
    int direction,
    int weighted,
    float noise,
    float damping,
    float largest_step,
    float keep,
    // Out:
    __global float *moved_out,
    __global float *information_out,
    __global float *residual_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    evidence_pixel(
        reference, other, disparity, along_x, along_y, guide, x, y, width, height, radius, stride, direction, weighted,
        noise, damping, largest_step, keep, moved_out, information_out, residual_out);
}
