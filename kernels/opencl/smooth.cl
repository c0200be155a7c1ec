// Separable Gaussian prefilter: one launch an axis.
// Weighted sum of 2 radius + 1 pixels along x (axis 0) or y (axis 1), the picture's edge repeated.
// The second pass (axis 1) rounds to whole grey levels, so that the correlation's sums stay exact.
__kernel void smooth(
    // In:
    __global const float *source,
    __global const float *weights,
    int width,
    int height,
    int radius,
    int axis,
    // Out:
    __global float *smoothed_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    float total = 0.0f;
    for (int i = 0; i < 2 * radius + 1; i++) {
        if (axis == 0)
            total += weights[i] * source[y * width + clamp_index(x + i - radius, width)];
        else
            total += weights[i] * source[clamp_index(y + i - radius, height) * width + x];
    }
    if (axis == 1) total = floor(total + 0.5f);
    smoothed_out[y * width + x] = total;
}
