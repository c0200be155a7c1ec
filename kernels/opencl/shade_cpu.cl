// Paint the triangles that a picture shows: the form for CPUs, whose work-items own a band of rows each.
#include "lanes.h"
#include "triangle.h"

// Four bytes at once, of which the last one belongs to the next texel: behind the last texel lies one more.
typedef uchar loose_four __attribute__((ext_vector_type(4), aligned(1)));
inline float4 load_texel(__global const uchar *level, int at)
{
    return __builtin_convertvector(*(__global const loose_four *)(level + at * 3), float4);
}
#define TEXEL load_texel
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
