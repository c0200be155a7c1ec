// How far a disparity is to be trusted.

// The score within 0..1, less the closer the runner-up comes to it, by weight; 0 where the pixel is not good.
__kernel void confidence(
    // In:
    __global const float *score,
    __global const float *ratio,
    __global const uchar *validity,
    int width,
    int height,
    float weight,
    // Out:
    __global float *confidence_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    int pixel = y * width + x;
    float trusted = score[pixel] * (1.0f - weight * ratio[pixel]);
    trusted = trusted < 1.0f ? trusted : 1.0f;
    confidence_out[pixel] = validity[pixel] == 0 && trusted > 0.0f ? trusted : 0.0f;
}
