// Median of the valid neighbours.

// Median over size x size (3, 5 or 7) neighbours that have a value; of an even number the lower one.
// A pixel without a value stays without. Missing neighbours count in turn as lowest and highest, so that
// the middle of the whole window is the median of the rest.
__kernel void median(
    // In:
    __global const float *disparity,
    int width,
    int height,
    int size,
    // Out:
    __global float *disparity_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    int pixel = y * width + x;
    disparity_out[pixel] = disparity[pixel];
    if (disparity[pixel] != disparity[pixel]) return;
    int radius = size / 2, total = size * size;
    float values[49];
    float filler = -INFINITY;
    for (int k = 0; k < total; k++) {
        int row = y + k / size - radius, column = x + k % size - radius;
        float value = NAN;
        if (row >= 0 && row < height && column >= 0 && column < width) value = disparity[row * width + column];
        if (value != value) {
            value = filler;
            filler = -filler;
        }
        values[k] = value;
    }
    // Selection up to the middle: bring the smallest of the rest forward, half of the window long.
    for (int k = 0; k <= total / 2; k++) {
        float low = values[k];
        for (int j = k + 1; j < total; j++) {
            float value = values[j];
            values[j] = value > low ? value : low;
            low = value > low ? low : value;
        }
        values[k] = low;
    }
    disparity_out[pixel] = values[total / 2];
}
