// Where a rectified pixel lies in the raw picture, and what is there; needs sampling.h.

// Undistort and rectify one pixel: its colour and 1, or black and 0 where the raw picture does not reach.
inline void rectify_pixel(
    __global const PIXEL *picture, __global const float *lens, __global const float *ray, int source_width,
    int source_height, int channels, int x, int y, int width, __global PIXEL *rectified_out, __global uchar *valid_out)
{
    int pixel = y * width + x, valid = 0;
    float column = (float)x, row = (float)y, u = 0.0f, v = 0.0f;
    float depth = ray[6] * column + ray[7] * row + ray[8];
    if (depth > 0.0f) {
        float a = (ray[0] * column + ray[1] * row + ray[2]) / depth;
        float b = (ray[3] * column + ray[4] * row + ray[5]) / depth;
        float r2 = a * a + b * b;
        float radial = 1.0f + r2 * (lens[4] + r2 * (lens[5] + r2 * lens[8]));
        radial = radial / (1.0f + r2 * (lens[9] + r2 * (lens[10] + r2 * lens[11])));
        float bent_a = a * radial + 2.0f * lens[6] * a * b + lens[7] * (r2 + 2.0f * a * a);
        float bent_b = b * radial + lens[6] * (r2 + 2.0f * b * b) + 2.0f * lens[7] * a * b;
        bent_a += r2 * (lens[12] + r2 * lens[13]);
        bent_b += r2 * (lens[14] + r2 * lens[15]);
        u = lens[0] * bent_a + lens[2];
        v = lens[1] * bent_b + lens[3];
        valid = u >= 0.0f && v >= 0.0f && u <= (float)(source_width - 1) && v <= (float)(source_height - 1);
    }
    valid_out[pixel] = valid;
    for (int channel = 0; channel < channels; channel++) {
        float value = 0.0f;
        if (valid) value = sample(picture, source_width, source_height, channels, channel, u, v);
        rectified_out[pixel * channels + channel] = (PIXEL)(value + 0.5f);
    }
}
