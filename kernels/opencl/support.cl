// Drop disparities that their surroundings do not share.
#define MISMATCH 8

// Keep a value that at least share of the pixels around it (within reach, every step-th) have, to tolerance px.
// A surface may lean: the tolerance grows by slope px with each row or column of distance.
// Pixels outside the picture or without a value do not share it.
__kernel void support(
    // In:
    __global const float *disparity,
    __global const uchar *validity,
    int width,
    int height,
    int reach,
    int step,
    float tolerance,
    float slope,
    float share,
    // Out:
    __global float *disparity_out,
    __global uchar *validity_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    int pixel = y * width + x;
    float value = disparity[pixel];
    disparity_out[pixel] = value;
    validity_out[pixel] = validity[pixel];
    if (value != value) return;
    int across = 2 * (reach / step) + 1, agreeing = 0;
    for (int k = 0; k < across * across; k++) {
        int row = y + (k / across - reach / step) * step, column = x + (k % across - reach / step) * step;
        if (row < 0 || row >= height || column < 0 || column >= width) continue;
        float difference = disparity[row * width + column] - value;
        int down = row < y ? y - row : row - y, across_by = column < x ? x - column : column - x;
        float allowed = tolerance + slope * (float)(down > across_by ? down : across_by);
        agreeing += difference <= allowed && -difference <= allowed;
    }
    if ((float)agreeing < share * (float)(across * across)) {
        disparity_out[pixel] = NAN;
        validity_out[pixel] = MISMATCH;
    }
}
