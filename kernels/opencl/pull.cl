// The next coarser level of a picture with gaps.
#include "light.h"

// Mean of those of 2 x 2 texels that are there (their fourth number is not 0); 0 where none is. (Gortler et al., "The
// Lumigraph", SIGGRAPH 1996, section 3.4.3: pull.) width and height are the coarser level's, half as much, rounded up.
__kernel void pull(
    // In:
    __global const ushort *fine,
    int fine_width,
    int fine_height,
    int width,
    int height,
    // Out:
    __global ushort *coarse_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    uint4 sum = (uint4)(0);
    uint many = 0;
    for (int k = 0; k < 4; k++) {
        int column = 2 * x + (k & 1), row = 2 * y + (k >> 1);
        if (column >= fine_width || row >= fine_height) continue;
        ushort4 texel = texel_at(fine, row * fine_width + column);
        if (texel.w == 0) continue;
        sum += (uint4)(texel.x, texel.y, texel.z, 65535);
        many++;
    }
    uint each = many > 1 ? many : 1;
    sum = (sum + each / 2) / each;
    put_texel(coarse_out, y * width + x, (ushort4)(sum.x, sum.y, sum.z, sum.w));
}
