// Resample a picture into a texture atlas, triangle by triangle.
#include "sampling.h"

inline float least(float a, float b, float c) { return a < b ? (a < c ? a : c) : (b < c ? b : c); }
inline float most(float a, float b, float c) { return a > b ? (a > c ? a : c) : (b > c ? b : c); }
inline int clamp_end(int index, int size) { return index < 0 ? 0 : index > size ? size : index; }

// Colour of every texel whose centre lies in a triangle, and 1 in covered_out; both must come in as 0.
// corners is (F, 3, 5): a corner's place in the atlas in texels, and u z, v z, z of its pixel (u, v) in the
// picture, so that perspective stays exact inside of a triangle. scale takes the picture's values to 0..255.
__kernel void bake(
    // In:
    __global const PIXEL *picture,
    __global const float *corners,
    int width,
    int height,
    int channels,
    int triangles,
    float scale,
    int texture_width,
    int texture_height,
    // Out:
    __global uchar *texture_out,
    __global uchar *covered_out)
{
    int face = get_global_id(0);
    if (face >= triangles) return;
    __global const float *at = corners + face * 15;
    float ax = at[0], ay = at[1], bx = at[5], by = at[6], cx = at[10], cy = at[11];
    float area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
    if (area == 0.0f) return;
    int first_x = clamp_end((int)floor(least(ax, bx, cx)), texture_width);
    int first_y = clamp_end((int)floor(least(ay, by, cy)), texture_height);
    int last_x = clamp_end((int)ceil(most(ax, bx, cx)), texture_width);
    int last_y = clamp_end((int)ceil(most(ay, by, cy)), texture_height);
    for (int y = first_y; y < last_y; y++) {
        for (int x = first_x; x < last_x; x++) {
            float px = (float)x + 0.5f, py = (float)y + 0.5f;
            float a = ((bx - px) * (cy - py) - (by - py) * (cx - px)) / area;
            float b = ((cx - px) * (ay - py) - (cy - py) * (ax - px)) / area;
            float c = 1.0f - a - b;
            if (a < 0.0f || b < 0.0f || c < 0.0f) continue;
            float z = a * at[4] + b * at[9] + c * at[14];
            float u = (a * at[2] + b * at[7] + c * at[12]) / z;
            float v = (a * at[3] + b * at[8] + c * at[13]) / z;
            int texel = y * texture_width + x;
            covered_out[texel] = 1;
            for (int channel = 0; channel < 3; channel++) {
                float value = scale * sample(picture, width, height, channels, channel < channels ? channel : channels - 1, u, v);
                texture_out[texel * 3 + channel] = (uchar)((value < 255.0f ? value : 255.0f) + 0.5f);
            }
        }
    }
}
