// Census transform: which pixels of a 5 x 5 window are darker than its centre.

// 24 bits, (H, W), in the order of the window, the first one highest; the picture's edge repeated (Zabih and
// Woodfill, ECCV 1994).
__kernel void census(
    // In:
    __global const float *picture,
    int width,
    int height,
    // Out:
    __global int *bits_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    float centre = picture[(long)y * width + x];
    int bits = 0;
    for (int j = -2; j <= 2; j++) {
        __global const float *row = picture + (long)clamp_index(y + j, height) * width;
        for (int i = -2; i <= 2; i++)
            if (i != 0 || j != 0) bits = bits * 2 + (row[clamp_index(x + i, width)] < centre ? 1 : 0);
    }
    bits_out[(long)y * width + x] = bits;
}
