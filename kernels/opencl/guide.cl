// Colour of a picture in levels that the camera's gain and offset do not change: what tells where depth may jump.

// floor(value gain + offset + 0.5), 0..255, of three planes, (3, H, W); a grey picture gives three equal ones.
__kernel void guide(
    // In:
    __global const PIXEL *picture,
    __global const float *levels, // gain and offset of each plane
    int width,
    int height,
    int channels,
    // Out:
    __global uchar *guide_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    long pixel = (long)y * width + x, plane = (long)width * height;
    for (int c = 0; c < 3; c++) {
        float value = (float)picture[channels == 1 ? pixel : pixel * channels + c];
        float level = value * levels[2 * c] + levels[2 * c + 1] + 0.5f;
        level = level > 0.0f ? level : 0.0f;
        guide_out[c * plane + pixel] = (uchar)(level < 255.0f ? level : 255.0f);
    }
}
