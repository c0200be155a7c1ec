// Resample a picture into a texture atlas.
#include "sampling.h"
#include "weights.h"

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
    int texel = y * texture_width + x, face = owner[texel] - 1;
    covered_out[texel] = face >= 0;
    float u = 0.0f, v = 0.0f;
    if (face >= 0) {
        __global const float *at = corners + face * 15;
        Weights share = weights(corners, face, x, y);
        float z = share.a * at[4] + share.b * at[9] + share.c * at[14];
        u = (share.a * at[2] + share.b * at[7] + share.c * at[12]) / z;
        v = (share.a * at[3] + share.b * at[8] + share.c * at[13]) / z;
    }
    for (int channel = 0; channel < 3; channel++) {
        float value = 0.0f;
        if (face >= 0)
            value = scale * sample(picture, width, height, channels, channel < channels ? channel : channels - 1, u, v);
        texture_out[texel * 3 + channel] = (uchar)((value < 255.0f ? value : 255.0f) + 0.5f);
    }
}
