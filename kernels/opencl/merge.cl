// The better of two disparity maps at every pixel.

// Take the rival where it has a value and the other has none, or scores less by more than margin.
__kernel void merge(
    // In:
    __global const float *disparity,
    __global const float *score,
    __global const uchar *validity,
    __global const float *rival_disparity,
    __global const float *rival_score,
    __global const uchar *rival_validity,
    int width,
    int height,
    float margin,
    // Out:
    __global float *disparity_out,
    __global float *score_out,
    __global uchar *validity_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    int pixel = y * width + x;
    int has = disparity[pixel] == disparity[pixel], rival_has = rival_disparity[pixel] == rival_disparity[pixel];
    int rival = rival_has && (!has || rival_score[pixel] > score[pixel] + margin);
    disparity_out[pixel] = rival ? rival_disparity[pixel] : disparity[pixel];
    score_out[pixel] = rival ? rival_score[pixel] : score[pixel];
    validity_out[pixel] = rival ? rival_validity[pixel] : validity[pixel];
}
