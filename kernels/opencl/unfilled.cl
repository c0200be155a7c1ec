// Leave out what was only filled in.
#define FILLED 32

// The disparity, NaN where it was filled in (FILLED in validity) and nothing sure has taken its place (taken is 0).
__kernel void unfilled(
    // In:
    __global const float *disparity,
    __global const uchar *validity,
    __global const uchar *taken,
    int width,
    int height,
    // Out:
    __global float *disparity_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    int pixel = y * width + x;
    disparity_out[pixel] = (validity[pixel] & FILLED) && !taken[pixel] ? NAN : disparity[pixel];
}
