// Grow the baked charts by one texel, so that no seam shows between them.
#include "dilate_texel.h"

// Give a texel without colour the mean of its coloured neighbours among the eight around it.
__kernel void dilate(
    // In:
    __global const uchar *texture,
    __global const uchar *covered,
    int width,
    int height,
    // Out:
    __global uchar *texture_out,
    __global uchar *covered_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    dilate_texel(texture, covered, width, height, x, y, texture_out, covered_out);
}
