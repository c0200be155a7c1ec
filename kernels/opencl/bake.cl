// Resample a picture into a texture atlas.
#include "sampling.h"
#include "weights.h"
#include "bake_texel.h"

// Colour of every texel that a triangle owns, and 1 in covered_out; 0 elsewhere.
// corners is (F, 3, 5): a corner's place in the atlas in texels, and u z, v z, z of its pixel (u, v) in the
// picture, so that perspective stays exact inside of a triangle. scale takes the picture's values to 0..255.
__kernel void bake(
    // In:
    __global const PIXEL *picture,
    __global const float *corners,
    __global const int *owner,
    int width,
    int height,
    int channels,
    float scale,
    int texture_width,
    int texture_height,
    // Out:
    __global uchar *texture_out,
    __global uchar *covered_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= texture_width || y >= texture_height) return;
    bake_texel(
        picture, corners, owner, width, height, channels, scale, texture_width, x, y, texture_out, covered_out);
}
