// Cost of every pixel at every disparity: how many census bits differ, and how much the colours do.
#define MASKED 16
#define NO_MATCH 255
#define UNSEEN 96

// Cost of matching reference(x, y) with other(x + direction d, y), 0..146, (H, W, D) with d fastest: the number of bits
// and the sum of colours that differ, both along a parabola that saturates (after AD-Census, Mei et al., 2011).
// UNSEEN where the other pixel is outside of the picture, NO_MATCH where either one is masked.
__kernel void match_cost(
    // In:
    __global const int *reference_bits,
    __global const int *other_bits,
    __global const uchar *reference_guide,
    __global const uchar *other_guide,
    __global const uchar *reference_validity,
    __global const uchar *other_validity,
    int width,
    int height,
    int smallest,
    int disparities,
    int direction,
    // Out:
    __global uchar *cost_out)
{
    int i = get_global_id(0), x = get_global_id(1), y = get_global_id(2);
    if (i >= disparities || x >= width || y >= height) return;
    int u = x + direction * (smallest + i);
    long row = (long)y * width, pixel = row + x, at = row + clamp_index(u, width), plane = (long)width * height;
    int cost = NO_MATCH;
    if (reference_validity[pixel] != MASKED && (u < 0 || u >= width)) {
        cost = UNSEEN;
    } else if (reference_validity[pixel] != MASKED && other_validity[at] != MASKED) {
        int bits = (int)popcount(reference_bits[pixel] ^ other_bits[at]), apart = 0;
        for (int c = 0; c < 3; c++) {
            int difference = (int)reference_guide[c * plane + pixel] - (int)other_guide[c * plane + at];
            apart += difference < 0 ? -difference : difference;
        }
        apart = apart < 48 ? apart : 48;
        cost = (bits * (48 - bits) * 45 >> 8) + (apart * (96 - apart) * 5 >> 8);
    }
    cost_out[pixel * disparities + i] = cost;
}
