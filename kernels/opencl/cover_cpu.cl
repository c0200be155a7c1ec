// Which triangle each texel of the atlas belongs to: the form for CPUs.
//
// A work-item owns a band of rows of the atlas and draws what every triangle has there, one after the other. Every
// vector holds LANES texels of a row.
#include "lanes.h"
#include "owner.h"
#include "extremes.h"

inline int between(int index, int low, int high) { return index < low ? low : index > high ? high : index; }

inline float squared(float x, float y) { return x * x + y * y; }

// A triangle: its corners, twice its area, what of cover.cl's squares may be below 0, and the columns of its box.
typedef struct {
    float ax, ay, bx, by, cx, cy, area, far_a, far_b, far_c, low, high;
} Drawn;

// Put in a triangle's number where the texel is in it or near it.
inline int_lanes draw(int_lanes owner, int x, float py, Drawn t, int number)
{
    // The same order of operations as in weights.h.
    lanes px = __builtin_convertvector(lane_numbers() + x, lanes) + 0.5f;
    lanes a = ((t.bx - px) * (t.cy - py) - (t.by - py) * (t.cx - px)) / t.area;
    lanes b = ((t.cx - px) * (t.ay - py) - (t.cy - py) * (t.ax - px)) / t.area;
    lanes c = 1.0f - a - b;
    int_lanes inside = a >= 0.0f & b >= 0.0f & c >= 0.0f;
    lanes off_a = a * t.area, off_b = b * t.area, off_c = c * t.area;
    off_a = a >= 0.0f ? 0.0f : off_a * off_a;
    off_b = b >= 0.0f ? 0.0f : off_b * off_b;
    off_c = c >= 0.0f ? 0.0f : off_c * off_c;
    int_lanes near = off_a <= t.far_a & off_b <= t.far_b & off_c <= t.far_c;
    int_lanes close = 4.0f * off_a <= t.far_a & 4.0f * off_b <= t.far_b & 4.0f * off_c <= t.far_c;
    int_lanes place = inside ? (int_lanes)(INSIDE) : close ? (int_lanes)(CLOSE) : (int_lanes)(0);
    int_lanes found = (inside | near) & px > t.low & px < t.high ? place + number : (int_lanes)(0);
    return found > owner ? found : owner;
}

// What cover.cl computes.
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
    int2 rows = band_of_rows(texture_height);
    for (int face = 0; face < triangles; face++) {
        __global const float *at = corners + (long)face * 15;
        Drawn t = {at[0], at[1], at[5], at[6], at[10], at[11]};
        int first_y = between(floor_to_int(least(t.ay, t.by, t.cy) - reach), rows.x, rows.y);
        int last_y = between(-floor_to_int(-most(t.ay, t.by, t.cy) - reach), rows.x, rows.y);
        if (first_y >= last_y) continue;
        t.area = (t.bx - t.ax) * (t.cy - t.ay) - (t.by - t.ay) * (t.cx - t.ax);
        if (t.area == 0.0f) continue;
        t.far_a = reach * reach * squared(t.bx - t.cx, t.by - t.cy);
        t.far_b = reach * reach * squared(t.cx - t.ax, t.cy - t.ay);
        t.far_c = reach * reach * squared(t.ax - t.bx, t.ay - t.by);
        int first_x = between(floor_to_int(least(t.ax, t.bx, t.cx) - reach), 0, texture_width);
        int last_x = between(-floor_to_int(-most(t.ax, t.bx, t.cx) - reach), 0, texture_width);
        t.low = (float)first_x;
        t.high = (float)last_x;
        for (int y = first_y; y < last_y; y++) {
            __global int *row = owner_out + (long)y * texture_width;
            for (int x = first_x; x < last_x; x += LANES) {
                // What lies beyond the triangle is put back as it was.
                int start = x + LANES <= texture_width ? x : texture_width - LANES;
                int_lanes owner = 0;
                if (start >= 0) {
                    owner = *(__global const int_lanes *)(row + start);
                } else {
                    start = 0;
                    for (int k = 0; k < texture_width; k++) owner[k] = row[k];
                }
                owner = draw(owner, start, (float)y + 0.5f, t, face + 1);
                if (texture_width >= LANES)
                    *(__global int_lanes *)(row + start) = owner;
                else
                    for (int k = 0; k < texture_width; k++) row[k] = owner[k];
            }
        }
    }
}
