// How much of what lies around a pixel both views agree about.

// Share of the pixels of the (2 radius + 1)^2 window, of which those outside of the picture do not count, that have a
// value in checked, which is NaN where the views disagree, and are not taken.
__kernel void agreement(
    // In:
    __global const float *checked,
    __global const uchar *taken,
    int width,
    int height,
    int radius,
    // Out:
    __global float *agreement_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    int top = y - radius > 0 ? y - radius : 0, bottom = y + radius < height ? y + radius : height - 1;
    int left = x - radius > 0 ? x - radius : 0, right = x + radius < width ? x + radius : width - 1, count = 0;
    for (int j = top; j <= bottom; j++) {
        for (int p = j * width + left; p <= j * width + right; p++) count += checked[p] == checked[p] && !taken[p];
    }
    agreement_out[y * width + x] = (float)count / (float)((bottom - top + 1) * (right - left + 1));
}
