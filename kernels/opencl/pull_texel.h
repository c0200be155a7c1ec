// One texel of pull; needs light.h.

// Mean of those of its 2 x 2 finer texels that are there. See pull.cl.
inline void pull_texel(
    __global const ushort *fine, int fine_width, int fine_height, int x, int y, int to, __global ushort *coarse_out)
{
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
    put_texel(coarse_out, to, (ushort4)(sum.x, sum.y, sum.z, sum.w));
}
