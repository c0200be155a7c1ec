// Gaps of a picture filled from its next coarser level.
#include "light.h"

// A texel that is not there (its fourth number is 0) becomes the coarser level's texel that it lies in. (Gortler et
// al., "The Lumigraph", SIGGRAPH 1996, section 3.4.3: push.)
__kernel void push(
    // In:
    __global const ushort *coarse,
    int coarse_width,
    int width,
    int height,
    // Out:
    __global ushort *fine_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    int texel = y * width + x;
    if (fine_out[texel * 4 + 3] == 0) put_texel(fine_out, texel, texel_at(coarse, y / 2 * coarse_width + x / 2));
}
