// Luma of a picture, centred and in whole steps: what the matching kernels read.
// Rec. 601 luma above black, times scale, rounded to whole grey levels 0..255, minus 128.
__kernel void grey(
    // In:
    __global const PIXEL *picture,
    int width,
    int height,
    int channels,
    float black,
    float scale,
    // Out:
    __global float *grey_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    int pixel = y * width + x;
    float luma;
    if (channels == 1) {
        luma = (float)picture[pixel];
    } else {
        float red = (float)picture[pixel * channels];
        float green = (float)picture[pixel * channels + 1];
        float blue = (float)picture[pixel * channels + 2];
        luma = 0.299f * red + 0.587f * green + 0.114f * blue;
    }
    // Whole numbers keep every sum of products of the correlation exact in float32.
    float scaled = (luma - black) * scale;
    scaled = scaled > 0.0f ? scaled : 0.0f;
    grey_out[pixel] = floor((scaled < 255.0f ? scaled : 255.0f) + 0.5f) - 128.0f;
}
