// Undistort and rectify in one resampling of the raw picture.
#include "sampling.h"
#include "rectify_pixel.h"

// The raw picture as the rectified camera would see it, and 1 where it has content; 0 and black elsewhere.
// ray is a (3, 3) matrix from rectified pixel (x, y, 1) to a direction in the raw camera's frame; lens is
// fx, fy, cx, cy and OpenCV's k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 of the raw camera.
__kernel void rectify(
    // In:
    __global const PIXEL *picture,
    __global const float *lens,
    __global const float *ray,
    int source_width,
    int source_height,
    int channels,
    int width,
    int height,
    // Out:
    __global PIXEL *rectified_out,
    __global uchar *valid_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    rectify_pixel(
        picture, lens, ray, source_width, source_height, channels, x, y, width, rectified_out, valid_out);
}
