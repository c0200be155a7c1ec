// The next coarser level of a picture with gaps.
#include "light.h"
#include "pull_texel.h"

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
    pull_texel(fine, fine_width, fine_height, x, y, y * width + x, coarse_out);
}
