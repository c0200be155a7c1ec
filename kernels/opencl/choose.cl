// Of the maps of two windows, the smaller one's wherever it has a value.

// Take the wider window's disparity, score, ratio and reason where the smaller window has no disparity.
__kernel void choose(
    // In:
    __global const float *disparity,
    __global const float *score,
    __global const float *ratio,
    __global const uchar *validity,
    __global const float *wider_disparity,
    __global const float *wider_score,
    __global const float *wider_ratio,
    __global const uchar *wider_validity,
    int width,
    int height,
    // Out:
    __global float *disparity_out,
    __global float *score_out,
    __global float *ratio_out,
    __global uchar *validity_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    int pixel = y * width + x, has = disparity[pixel] == disparity[pixel];
    disparity_out[pixel] = has ? disparity[pixel] : wider_disparity[pixel];
    score_out[pixel] = has ? score[pixel] : wider_score[pixel];
    ratio_out[pixel] = has ? ratio[pixel] : wider_ratio[pixel];
    validity_out[pixel] = has ? validity[pixel] : wider_validity[pixel];
}
