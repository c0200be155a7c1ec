// Take planes where most of the surroundings want them.

// A pixel takes its plane, where it has one, if at least half of the pixels of the (2 radius + 1)^2 window around it
// that lie in the picture want theirs.
__kernel void majority(
    // In:
    __global const uchar *wanted,
    __global const float *plane,
    __global const float *disparity,
    int width,
    int height,
    int radius,
    // Out:
    __global float *disparity_out,
    __global uchar *taken_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    int top = y - radius > 0 ? y - radius : 0, bottom = y + radius < height ? y + radius : height - 1;
    int left = x - radius > 0 ? x - radius : 0, right = x + radius < width ? x + radius : width - 1, count = 0;
    for (int j = top; j <= bottom; j++) {
        for (int p = j * width + left; p <= j * width + right; p++) count += wanted[p] != 0;
    }
    int pixel = y * width + x, pixels = (bottom - top + 1) * (right - left + 1);
    int taken = 2 * count >= pixels && plane[pixel] == plane[pixel];
    disparity_out[pixel] = taken ? plane[pixel] : disparity[pixel];
    taken_out[pixel] = (uchar)taken;
}
