// One texel of bake; needs sampling.h and weights.h.

// Colour of a texel that a triangle owns, and 1; black and 0 elsewhere. See bake.cl.
inline void bake_texel(
    __global const PIXEL *picture, __global const float *corners, __global const int *owner, int width, int height,
    int channels, float scale, int texture_width, int x, int y, __global uchar *texture_out,
    __global uchar *covered_out)
{
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
