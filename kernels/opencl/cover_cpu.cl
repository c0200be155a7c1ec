// Which triangle each texel of the atlas belongs to: the form for CPUs.
//
// A work-item owns a band of rows of the atlas and draws what every triangle has there, one after the other, so that
// the last one wins. Every vector holds LANES texels of a row.
#include "lanes.h"

inline float least(float a, float b, float c) { return a < b ? (a < c ? a : c) : (b < c ? b : c); }
inline float most(float a, float b, float c) { return a > b ? (a > c ? a : c) : (b > c ? b : c); }
inline int between(int index, int low, int high) { return index < low ? low : index > high ? high : index; }

// Put in a triangle's number where the texel is in it.
inline int_lanes draw(
    int_lanes owner, int x, float py, float ax, float ay, float bx, float by, float cx, float cy, float area,
    int number)
{
    // The same order of operations as in weights.h.
    lanes px = __builtin_convertvector(lane_numbers() + x, lanes) + 0.5f;
    lanes a = ((bx - px) * (cy - py) - (by - py) * (cx - px)) / area;
    lanes b = ((cx - px) * (ay - py) - (cy - py) * (ax - px)) / area;
    lanes c = 1.0f - a - b;
    return (a >= 0.0f & b >= 0.0f & c >= 0.0f) ? number : owner;
}

// What cover.cl computes.
__kernel void cover(
    // In:
    __global const float *corners,
    int triangles,
    int texture_width,
    int texture_height,
    // Out:
    __global int *owner_out)
{
    int2 rows = band_of_rows(texture_height);
    for (int face = 0; face < triangles; face++) {
        __global const float *at = corners + (long)face * 15;
        float ay = at[1], by = at[6], cy = at[11];
        int first_y = between(floor_to_int(least(ay, by, cy)), rows.x, rows.y);
        int last_y = between(-floor_to_int(-most(ay, by, cy)), rows.x, rows.y);
        if (first_y >= last_y) continue;
        float ax = at[0], bx = at[5], cx = at[10];
        float area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
        if (area == 0.0f) continue;
        int first_x = between(floor_to_int(least(ax, bx, cx)), 0, texture_width);
        int last_x = between(-floor_to_int(-most(ax, bx, cx)), 0, texture_width);
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
                owner = draw(owner, start, (float)y + 0.5f, ax, ay, bx, by, cx, cy, area, face + 1);
                if (texture_width >= LANES)
                    *(__global int_lanes *)(row + start) = owner;
                else
                    for (int k = 0; k < texture_width; k++) row[k] = owner[k];
            }
        }
    }
}
