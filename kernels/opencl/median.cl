// Median of the valid neighbours.

// Median over size x size (3, 5 or 7) neighbours that have a value; of an even number the lower one.
// A pixel without a value stays without. From the pixel's own value it goes to the next larger or smaller one until
// half of the values lie below: few steps where a map is smooth, and no array of values, which no GPU holds in
// registers.
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
    int pixel = y * width + x, radius = size / 2;
    float middle = disparity[pixel];
    disparity_out[pixel] = middle;
    if (middle != middle) return;
    int top = y > radius ? y - radius : 0, bottom = y + radius < height ? y + radius : height - 1;
    int left = x > radius ? x - radius : 0, right = x + radius < width ? x + radius : width - 1;
    // Values in all, below the middle, and equal to it; comparisons with what is missing are false.
    int all = 0, below = 0, equal = 0;
    for (int row = top; row <= bottom; row++) {
        for (int column = left; column <= right; column++) {
            float value = disparity[row * width + column];
            all += value == value;
            below += value < middle;
            equal += value == middle;
        }
    }
    int wanted = (all - 1) / 2;
    while (below > wanted || below + equal <= wanted) {
        int down = below > wanted, found = 0;
        float next = down ? -INFINITY : INFINITY;
        for (int row = top; row <= bottom; row++) {
            for (int column = left; column <= right; column++) {
                float value = disparity[row * width + column];
                int beyond = down ? value < middle : value > middle, nearer = down ? value > next : value < next;
                found = beyond && nearer ? 1 : found + (beyond && value == next);
                next = beyond && nearer ? value : next;
            }
        }
        below += down ? -found : equal;
        equal = found;
        middle = next;
    }
    disparity_out[pixel] = middle;
}
