// Sum and inverse norm of the window around every pixel, and which pixels can be matched at all.
// Sum I and 1 / ||I - mean|| over the window, the picture's edge repeated; a work-item is a strip of rows.
// The inverse norm is 0, so that nothing correlates, where the norm is at most threshold (grey levels,
// sqrt of the sum of squares) or the mask is 0.
#define TEXTURELESS 2
#define MASKED 16

__kernel void window_norms(
    // In:
    __global const float *picture,
    __global const uchar *mask,
    int width,
    int height,
    int radius,
    float threshold,
    int rows,
    // Out:
    __global float *sum_out,
    __global float *inverse_out,
    __global uchar *validity_out)
{
    int x = get_global_id(0), first = get_global_id(1) * rows;
    if (x >= width || first >= height) return;
    float count = (float)((2 * radius + 1) * (2 * radius + 1));
    float total = 0.0f, squares = 0.0f;
    int last = first + rows < height ? first + rows : height;
    for (int y = first - 2 * radius; y < last; y++) {
        int entering = clamp_index(y + radius, height) * width;
        for (int i = -radius; i <= radius; i++) {
            float value = picture[entering + clamp_index(x + i, width)];
            total += value;
            squares += value * value;
        }
        if (y < first) continue;
        int pixel = y * width + x;
        // Sums of whole numbers are exact; their product is not, but the difference of squares
        // loses little as the values are centred.
        float energy = squares - total * (total / count);
        int masked = mask[pixel] == 0, flat = energy <= threshold * threshold;
        sum_out[pixel] = total;
        inverse_out[pixel] = masked || flat ? 0.0f : 1.0f / sqrt(energy);
        validity_out[pixel] = masked ? MASKED : flat ? TEXTURELESS : 0;
        int leaving = clamp_index(y - radius, height) * width;
        for (int i = -radius; i <= radius; i++) {
            float value = picture[leaving + clamp_index(x + i, width)];
            total -= value;
            squares -= value * value;
        }
    }
}
