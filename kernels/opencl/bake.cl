// Resample a picture into a texture atlas.
#include "light.h"
#include "cubic.h"
#include "bake_texel.h"

// Adds (sample - bias) gain to every texel that has a place in the picture, see place.cl, within 0..65535, and sets its
// fourth number to 65535. A pixel of `light` is `cell` pixels of that picture wide.
__kernel void bake(
    // In:
    __global const ushort *light,
    __global const float *places,
    int width,
    int height,
    float cell,
    float bias,
    float gain,
    int texture_width,
    int texture_height,
    // Out:
    __global ushort *texture_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= texture_width || y >= texture_height) return;
    int texel = y * texture_width + x;
    float u = places[texel], v = places[texture_width * texture_height + texel];
    if (u == u) bake_texel(light, width, height, u, v, 1.0f / cell, bias, gain, texel, texture_out);
}
