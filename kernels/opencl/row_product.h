// Sum over one row of the window of reference(x + i) other(u + i), the picture's edge repeated.
inline float row_product(
    __global const float *reference, __global const float *other, int row, int x, int u, int width, int radius)
{
    float total = 0.0f;
    for (int i = -radius; i <= radius; i++)
        total += reference[row + clamp_index(x + i, width)] * other[row + clamp_index(u + i, width)];
    return total;
}
