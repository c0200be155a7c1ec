// Linear light as a picture's levels.

// Levels 0 to 255 of every texel's red, green and blue, by a table of 65536; its fourth number is left out.
__kernel void encode(
    // In:
    __global const ushort *light,
    __global const uchar *table,
    int width,
    int height,
    // Out:
    __global uchar *picture_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    int texel = y * width + x;
    picture_out[texel * 3] = table[light[texel * 4]];
    picture_out[texel * 3 + 1] = table[light[texel * 4 + 1]];
    picture_out[texel * 3 + 2] = table[light[texel * 4 + 2]];
}
