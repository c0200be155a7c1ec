// One texel of dilate.

// Give a texel without colour the mean of its coloured neighbours among the eight around it.
inline void dilate_texel(
    __global const uchar *texture, __global const uchar *covered, int width, int height, int x, int y,
    __global uchar *texture_out, __global uchar *covered_out)
{
    int texel = y * width + x, coloured = 0;
    float red = 0.0f, green = 0.0f, blue = 0.0f;
    for (int k = 0; k < 9; k++) {
        int row = y + k / 3 - 1, column = x + k % 3 - 1;
        if (row < 0 || row >= height || column < 0 || column >= width) continue;
        int near = row * width + column;
        if (!covered[near] || (covered[texel] && near != texel)) continue;
        coloured++;
        red += (float)texture[near * 3];
        green += (float)texture[near * 3 + 1];
        blue += (float)texture[near * 3 + 2];
    }
    float many = (float)(coloured > 1 ? coloured : 1);
    covered_out[texel] = coloured > 0;
    texture_out[texel * 3] = (uchar)(red / many + 0.5f);
    texture_out[texel * 3 + 1] = (uchar)(green / many + 0.5f);
    texture_out[texel * 3 + 2] = (uchar)(blue / many + 0.5f);
}
