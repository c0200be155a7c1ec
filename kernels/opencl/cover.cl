// Which triangle each texel of the atlas belongs to.
#include "weights.h"

inline float least(float a, float b, float c) { return a < b ? (a < c ? a : c) : (b < c ? b : c); }
inline float most(float a, float b, float c) { return a > b ? (a > c ? a : c) : (b > c ? b : c); }
inline int clamp_end(int index, int size) { return index < 0 ? 0 : index > size ? size : index; }

// Number of the last triangle that holds the texel's centre, counted from 1; must come in as 0.
// corners is (F, 3, 5), a corner's place in the atlas in texels first. The last one wins whatever the order in
// which triangles are drawn, so that a texture does not change from run to run.
__kernel void cover(
    // In:
    __global const float *corners,
    int triangles,
    int texture_width,
    int texture_height,
    // Out:
    __global int *owner_out)
{
    int face = get_global_id(0);
    if (face >= triangles) return;
    __global const float *at = corners + face * 15;
    int first_x = clamp_end((int)floor(least(at[0], at[5], at[10])), texture_width);
    int first_y = clamp_end((int)floor(least(at[1], at[6], at[11])), texture_height);
    int last_x = clamp_end((int)ceil(most(at[0], at[5], at[10])), texture_width);
    int last_y = clamp_end((int)ceil(most(at[1], at[6], at[11])), texture_height);
    for (int y = first_y; y < last_y; y++) {
        for (int x = first_x; x < last_x; x++) {
            Weights inside = weights(corners, face, x, y);
            if (inside.a >= 0.0f && inside.b >= 0.0f && inside.c >= 0.0f)
                atomic_max(owner_out + y * texture_width + x, face + 1);
        }
    }
}
