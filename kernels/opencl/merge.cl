// Of two disparity maps, the one whose surroundings cost less.

// Take the rival where over the (2 radius + 1)^2 pixels around, without those where either map has no value or that
// lie outside of the picture, the mean of lowest - rival_lowest exceeds margin. Where one map has no value, the other
// is taken. lowest and rival_lowest are whole numbers, whose sums are exact in any order below 2^24.
__kernel void merge(
    // In:
    __global const float *disparity,
    __global const float *lowest,
    __global const uchar *validity,
    __global const float *ratio,
    __global const float *rival_disparity,
    __global const float *rival_lowest,
    __global const uchar *rival_validity,
    __global const float *rival_ratio,
    int width,
    int height,
    int radius,
    float margin,
    // Out:
    __global float *disparity_out,
    __global float *lowest_out,
    __global uchar *validity_out,
    __global float *ratio_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    int pixel = y * width + x;
    float gain = 0.0f, count = 0.0f;
    int top = y - radius > 0 ? y - radius : 0, bottom = y + radius < height ? y + radius : height - 1;
    int left = x - radius > 0 ? x - radius : 0, right = x + radius < width ? x + radius : width - 1;
    for (int j = top; j <= bottom; j++) {
        for (int p = j * width + left; p <= j * width + right; p++) {
            if (disparity[p] != disparity[p] || rival_disparity[p] != rival_disparity[p]) continue;
            gain += lowest[p] - rival_lowest[p];
            count += 1.0f;
        }
    }
    int has = disparity[pixel] == disparity[pixel], rival_has = rival_disparity[pixel] == rival_disparity[pixel];
    int rival = rival_has && (!has || gain > margin * count);
    disparity_out[pixel] = rival ? rival_disparity[pixel] : disparity[pixel];
    lowest_out[pixel] = rival ? rival_lowest[pixel] : lowest[pixel];
    validity_out[pixel] = rival ? rival_validity[pixel] : validity[pixel];
    ratio_out[pixel] = rival ? rival_ratio[pixel] : ratio[pixel];
}
