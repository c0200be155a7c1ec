// Cost of every pixel at every disparity: how many census bits differ.
#define MASKED 16
#define NO_MATCH 255
#define UNSEEN 254

// Hamming distance, 0..62, of reference(x, y) and other(x + direction d, y), (H, W, D) with d fastest.
// UNSEEN where the other pixel is outside of the picture, NO_MATCH where either one is masked.
__kernel void census_volume(
    // In:
    __global const int *reference_bits,
    __global const int *other_bits,
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
    int pixel = y * width + x, u = x + direction * (smallest + i), at = y * width + clamp_index(u, width);
    int cost = NO_MATCH;
    if (reference_validity[pixel] != MASKED && (u < 0 || u >= width))
        cost = UNSEEN;
    else if (reference_validity[pixel] != MASKED && other_validity[at] != MASKED)
        cost = (int)popcount(reference_bits[pixel * 2] ^ other_bits[at * 2])
               + (int)popcount(reference_bits[pixel * 2 + 1] ^ other_bits[at * 2 + 1]);
    cost_out[(long)pixel * disparities + i] = cost;
}
