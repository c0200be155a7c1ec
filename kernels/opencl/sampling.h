// Bilinear samples of a picture of any pixel type.

// Bilinear value at column u, row v (pixel centres at whole numbers), the picture's edge repeated.
inline float sample(
    __global const PIXEL *picture, int width, int height, int channels, int channel, float u, float v)
{
    int x = floor_to_int(u), y = floor_to_int(v);
    float across = u - (float)x, down = v - (float)y;
    int left = clamp_index(x, width), right = clamp_index(x + 1, width);
    int top = clamp_index(y, height) * width, bottom = clamp_index(y + 1, height) * width;
    float upper = (float)picture[(top + left) * channels + channel] * (1.0f - across);
    upper += (float)picture[(top + right) * channels + channel] * across;
    float lower = (float)picture[(bottom + left) * channels + channel] * (1.0f - across);
    lower += (float)picture[(bottom + right) * channels + channel] * across;
    return upper * (1.0f - down) + lower * down;
}
