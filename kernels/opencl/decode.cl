// A picture's levels as linear light.

// Light of every valid pixel, 16 bits each of red, green, blue and 65535: what the table says of the pixel's levels,
// which must not be more than it has entries; a grey picture has the same in all three. 0 where a pixel is not valid.
__kernel void decode(
    // In:
    __global const PIXEL *picture,
    __global const uchar *valid,
    __global const ushort *table,
    int width,
    int height,
    int channels,
    // Out:
    __global ushort *light_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    int pixel = y * width + x;
    __global const PIXEL *levels = picture + pixel * channels;
    int there = valid[pixel] != 0;
    light_out[pixel * 4] = there ? table[levels[0]] : 0;
    light_out[pixel * 4 + 1] = there ? table[levels[channels > 1 ? 1 : 0]] : 0;
    light_out[pixel * 4 + 2] = there ? table[levels[channels > 2 ? 2 : 0]] : 0;
    light_out[pixel * 4 + 3] = there ? 65535 : 0;
}
