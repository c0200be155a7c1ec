// Which pixels of a view are not to be matched.
#define MASKED 16

// MASKED where the mask is 0, else 0.
__kernel void masked(
    // In:
    __global const uchar *mask,
    int width,
    int height,
    // Out:
    __global uchar *validity_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    validity_out[y * width + x] = mask[y * width + x] ? 0 : MASKED;
}
