// Paint the triangles that a picture shows: the form for CPUs, whose work-items own a band of rows each.
#include "lanes.h"
#include "triangle.h"
#include "shade_pixel.h"

// What shade.cl computes.
__kernel void shade(
    // In:
    __global const int *owner,
    __global const float *screen,
    __global const int *faces,
    __global const float *uv,
    __global const uchar *texture,
    __global const uchar *colours,
    int texture_width,
    int texture_height,
    int texture_levels,
    float behind,
    float wire,
    int samples,
    int width,
    int height,
    // Out:
    __global uchar *picture_out)
{
    int2 rows = band_of_rows(height);
    for (int y = rows.x; y < rows.y; y++)
        for (int x = 0; x < width; x++)
            shade_pixel(
                owner, screen, faces, uv, texture, colours, texture_width, texture_height, texture_levels, behind,
                wire, samples, width, x, y, picture_out);
}
