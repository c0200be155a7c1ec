// Which triangle each texel of the atlas belongs to.
#include "owner.h"
#include "weights.h"
#include "extremes.h"

inline int clamp_end(int index, int size) { return index < 0 ? 0 : index > size ? size : index; }

// Squared length of a side.
inline float squared(float x, float y) { return x * x + y * y; }

// Number of the last triangle that holds the texel's centre, counted from 1, and INSIDE; where none does, of the last
// one that has it within half of `reach` texels of its sides, and CLOSE, or within `reach`. Must come in as 0.
// corners is (F, 3, 5), a corner's place in the atlas in texels first. The last one wins whatever the order in
// which triangles are drawn, so that a texture does not change from run to run.
__kernel void cover(
    // In:
    __global const float *corners,
    int triangles,
    float reach,
    int texture_width,
    int texture_height,
    // Out:
    __global int *owner_out)
{
    int face = get_global_id(0);
    if (face >= triangles) return;
    __global const float *at = corners + face * 15;
    float ax = at[0], ay = at[1], bx = at[5], by = at[6], cx = at[10], cy = at[11];
    float area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
    if (area == 0.0f) return;
    // A weight times the area is the distance from its side times that side's length.
    float far_a = reach * reach * squared(bx - cx, by - cy);
    float far_b = reach * reach * squared(cx - ax, cy - ay);
    float far_c = reach * reach * squared(ax - bx, ay - by);
    int first_x = clamp_end(floor_to_int(least(ax, bx, cx) - reach), texture_width);
    int first_y = clamp_end(floor_to_int(least(ay, by, cy) - reach), texture_height);
    int last_x = clamp_end(-floor_to_int(-most(ax, bx, cx) - reach), texture_width);
    int last_y = clamp_end(-floor_to_int(-most(ay, by, cy) - reach), texture_height);
    for (int y = first_y; y < last_y; y++) {
        for (int x = first_x; x < last_x; x++) {
            Weights share = weights(corners, face, x, y);
            int inside = share.a >= 0.0f && share.b >= 0.0f && share.c >= 0.0f;
            float a = share.a * area, b = share.b * area, c = share.c * area;
            a = share.a >= 0.0f ? 0.0f : a * a;
            b = share.b >= 0.0f ? 0.0f : b * b;
            c = share.c >= 0.0f ? 0.0f : c * c;
            int near = a <= far_a && b <= far_b && c <= far_c;
            int close = 4.0f * a <= far_a && 4.0f * b <= far_b && 4.0f * c <= far_c;
            int place = inside ? INSIDE : close ? CLOSE : 0;
            if (inside || near) atomic_max(owner_out + y * texture_width + x, face + 1 + place);
        }
    }
}
