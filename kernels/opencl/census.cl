// Census transform: which pixels of a 9 x 7 window are darker than its centre.

// 62 bits in two numbers of 31, (H, W, 2), the picture's edge repeated (Zabih and Woodfill, ECCV 1994).
// Each row of the window lies row_shift px further right than the one above it: how the other view sees the
// square window of a surface whose disparity changes by so much a row.
__kernel void census(
    // In:
    __global const float *picture,
    int width,
    int height,
    int row_shift,
    // Out:
    __global int *bits_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    float centre = picture[y * width + x];
    int upper = 0, lower = 0;
    for (int k = 0; k < 31; k++) {
        // Pixel k of the first half in reading order, and its mirror image through the centre.
        int row = k / 9 - 3, column = k % 9 - 4 + row_shift * row;
        float first = picture[clamp_index(y + row, height) * width + clamp_index(x + column, width)];
        float mirrored = picture[clamp_index(y - row, height) * width + clamp_index(x - column, width)];
        upper = upper * 2 + (first < centre ? 1 : 0);
        lower = lower * 2 + (mirrored < centre ? 1 : 0);
    }
    bits_out[(y * width + x) * 2] = upper;
    bits_out[(y * width + x) * 2 + 1] = lower;
}
