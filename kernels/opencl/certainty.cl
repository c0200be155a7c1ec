// How likely a disparity of smooth paths is right.

// About the probability that a disparity found by smooth paths is right to 1 px; 0 where the pixel is not good.
// It falls with the cube of the ratio of the lowest sum of costs to the runner-up's, by `doubt` where both are equal.
__kernel void certainty(
    // In:
    __global const float *ratio,
    __global const uchar *validity,
    int width,
    int height,
    float doubt,
    // Out:
    __global float *confidence_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    int pixel = y * width + x;
    float rival = ratio[pixel] < 1.0f ? ratio[pixel] : 1.0f;
    confidence_out[pixel] = validity[pixel] == 0 ? 1.0f - doubt * (rival * rival * rival) : 0.0f;
}
