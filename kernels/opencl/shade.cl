// Paint the triangles that a picture shows.
#include "triangle.h"
#include "shade_pixel.h"

// Colours of a picture of which each pixel has samples x samples samples, whose triangles rasterise has found.
//
// screen and faces are those of rasterise. uv (N, 2) places the vertices in the texture, (0, 0) its top left corner;
// behind is added to v where a face is seen from behind. texture holds texture_levels pictures one after the other,
// RGB, each with half the side of the one before, rounded up; of a face that covers k texels a sample, the level is the
// one where that is 1 to 4, and (k - 1) / 3 of the next one is mixed in (after Williams 1983). Along the edges lies
// ink, about wire samples wide, thinly where a face is small. colours: background and ink, RGB.
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
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    shade_pixel(
        owner, screen, faces, uv, texture, colours, texture_width, texture_height, texture_levels, behind, wire,
        samples, width, x, y, picture_out);
}
