// Where in another picture each texel of a mesh lies: the form for CPUs.
//
// A work-item owns a band of rows and takes LANES texels at a time, each with its own triangle.
#include "lanes.h"
#include "owner.h"
#include "weights.h"
#include "extremes.h"
#include "place.h"
#include "quarters.h"
typedef struct {
    lanes u, v;
} Places;

inline lanes least_lanes(lanes a, lanes b, lanes c)
{
    lanes least = a < b ? a : b;
    return least < c ? least : c;
}

inline lanes most_lanes(lanes a, lanes b, lanes c)
{
    lanes most = a > b ? a : b;
    return most > c ? most : c;
}

inline lanes within_lanes(lanes v, lanes low, lanes high)
{
    lanes above = v > low ? v : low;
    return above < high ? above : high;
}

// Places that the centres of texels from (x, y) on show, each in its own triangle; the same order of operations as in
// weights.h and place.h.
inline Places find_places(__global const float *corners, int_lanes number, int x, int y, float margin)
{
    int_lanes face = (number & (CLOSE - 1)) - 1, inside = number > INSIDE;
    lanes ax, ay, au, av, az, bx, by, bu, bv, bz, cx, cy, cu, cv, cz;
    load_fours(corners, face * 15, &ax, &ay, &au, &av);
    load_fours(corners, face * 15 + 4, &az, &bx, &by, &bu);
    load_fours(corners, face * 15 + 8, &bv, &bz, &cx, &cy);
    load_fours(corners, face * 15 + 11, &cy, &cu, &cv, &cz);
    lanes px = __builtin_convertvector(lane_numbers() + x, lanes) + 0.5f;
    float py = (float)y + 0.5f;
    lanes area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
    lanes a = ((bx - px) * (cy - py) - (by - py) * (cx - px)) / area;
    lanes b = ((cx - px) * (ay - py) - (cy - py) * (ax - px)) / area;
    lanes c = 1.0f - a - b;
    a = area == 0.0f ? -1.0f : a;
    b = area == 0.0f ? -1.0f : b;
    c = area == 0.0f ? -1.0f : c;
    a = a * (inside ? az : 1.0f);
    b = b * (inside ? bz : 1.0f);
    c = c * (inside ? cz : 1.0f);
    lanes sum = a + b + c;
    Places at = {(a * au + b * bu + c * cu) / sum, (a * av + b * bv + c * cv) / sum};
    at.u = within_lanes(at.u, least_lanes(au, bu, cu) - margin, most_lanes(au, bu, cu) + margin);
    at.v = within_lanes(at.v, least_lanes(av, bv, cv) - margin, most_lanes(av, bv, cv) + margin);
    return at;
}

// What place.cl computes.
__kernel void place(
    // In:
    __global const float *corners,
    __global const int *owner,
    float margin,
    int texture_width,
    int texture_height,
    // Out:
    __global float *place_out)
{
    int2 rows = band_of_rows(texture_height);
    for (int y = rows.x; y < rows.y; y++) {
        __global const int *owners = owner + (long)y * texture_width;
        __global float *us = place_out + (long)y * texture_width, *vs = us + (long)texture_height * texture_width;
        int x = 0;
        for (; x + LANES <= texture_width; x += LANES) {
            int_lanes number = *(__global const int_lanes *)(owners + x), owned = number > 0;
            Places found = {NAN, NAN};
            if (any_lane(owned)) found = find_places(corners, owned ? number : 1, x, y, margin);
            *(__global lanes *)(us + x) = owned ? found.u : NAN;
            *(__global lanes *)(vs + x) = owned ? found.v : NAN;
        }
        for (; x < texture_width; x++) {
            Place found = {NAN, NAN};
            if (owners[x]) found = find_place(corners, owners[x], x, y, margin);
            us[x] = found.u;
            vs[x] = found.v;
        }
    }
}
