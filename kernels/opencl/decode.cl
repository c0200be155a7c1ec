// A picture's levels as linear light.

// Light of every pixel, 16 bits each of red, green, blue and 65535: what the table says of the pixel's levels, which
// must not be more than it has entries. A grey picture has the same in all three.
__kernel void decode(
    // In:
    __global const PIXEL *picture,
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
    light_out[pixel * 4] = table[levels[0]];
    light_out[pixel * 4 + 1] = table[levels[channels > 1 ? 1 : 0]];
    light_out[pixel * 4 + 2] = table[levels[channels > 2 ? 2 : 0]];
    light_out[pixel * 4 + 3] = 65535;
}
