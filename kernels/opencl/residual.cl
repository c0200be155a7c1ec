// What a textured mesh, seen from the camera of its picture, lacks of that picture.
#include "light.h"
#include "residual_pixel.h"

// 32768 and half the difference of a pixel's light to the texture's at its place, see place.cl, sampled bilinearly as a
// viewer does; 32768 where it has none, or a texel is missing. Texel centres are at whole numbers.
__kernel void residual(
    // In:
    __global const ushort *light,
    __global const ushort *texture,
    __global const float *places,
    int texture_width,
    int texture_height,
    int width,
    int height,
    // Out:
    __global ushort *residual_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    int pixel = y * width + x;
    float s = places[pixel], t = places[width * height + pixel];
    if (s == s)
        residual_pixel(light, texture, texture_width, texture_height, pixel, s, t, residual_out);
    else
        put_texel(residual_out, pixel, (ushort4)(32768));
}
