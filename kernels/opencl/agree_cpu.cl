// Left-right check of two maps: the form for CPUs, whose work-items take a band of rows each.
//
// What needs an address from each lane is done one by one between loops over vectors, which leave and find it in
// arrays. Only pixels that fail, which are few, look for their reason, in columns of the other view side by side.
#include "lanes.h"
#define OCCLUDED 4
#define MISMATCH 8

// Whether the other view sees a point at a whole disparity of the range on the ray of column x. Those between columns
// from and to - 1 may lie on it, at disparity direction * (u - x).
inline int sees_another(__global const float *row, int x, int from, int to, int direction, float tolerance)
{
    int u = from;
    for (; u + LANES <= to; u += LANES) {
        int_lanes d = direction * (lane_numbers() + (u - x));
        lanes apart = magnitude(*(__global const lanes *)(row + u) - __builtin_convertvector(d, lanes));
        if (any_lane(apart <= tolerance)) return 1;
    }
    for (; u < to; u++) {
        float difference = row[u] - (float)(direction * (u - x));
        if (difference <= tolerance && -difference <= tolerance) return 1;
    }
    return 0;
}

// Take a disparity away where the other view's own map differs from it by more than tolerance px at the pixel that it
// points at. After Hirschmueller (PAMI 2008), section 2.5: a pixel is a mismatch if the other view sees a point
// somewhere on its ray, which is a whole disparity of the range to tolerance px, else it is occluded.
__kernel void agree(
    // In:
    __global const float *disparity,
    __global const uchar *validity,
    __global const float *other_disparity,
    int width,
    int height,
    int smallest,
    int disparities,
    int direction,
    float tolerance,
    // Out:
    __global float *disparity_out,
    __global uchar *validity_out)
{
    int2 band = band_of_rows(height);
    int one = direction * smallest, two = direction * (smallest + disparities - 1);
    int nearest = one < two ? one : two, farthest = one < two ? two : one;
    int_lanes counting = lane_numbers();
    float values[BLOCK] ALIGNED, partners[BLOCK] ALIGNED;
    int places[BLOCK] ALIGNED;
    for (int y = band.x; y < band.y; y++) {
        long place = (long)y * width;
        __global const float *row = other_disparity + place;
        for (int start = 0; start < width; start += BLOCK) {
            int columns = start + BLOCK < width ? BLOCK : width - start;
            load_line(values, disparity + place, start, columns, width, 0);
            for (int k = 0; k < columns; k += LANES) {
                lanes value = *(lanes *)(values + k);
                lanes whole = floor_lanes((value == value ? value : (lanes)(0.0f)) + 0.5f);
                int_lanes u = counting + (start + k) + direction * __builtin_convertvector(whole, int_lanes);
                *(int_lanes *)(places + k) = u >= 0 && u < width ? u : (int_lanes)(-1);
            }
            int whole = (columns + LANES - 1) / LANES * LANES;
            for (int k = 0; k < whole; k++) partners[k] = places[k] < 0 ? NAN : row[places[k]];
            for (int k = 0; k < columns; k += LANES) {
                int x = start + k;
                lanes value = *(lanes *)(values + k);
                int_lanes agrees = magnitude(*(lanes *)(partners + k) - value) <= tolerance;
                int_lanes fails = value == value && !agrees, reasons = load_reasons(validity + place, x, width);
                store_lanes(disparity_out + place, x, width, fails ? (lanes)(NAN) : value);
                store_reasons(validity_out + place, x, width, fails ? (int_lanes)(OCCLUDED) : reasons);
                if (!any_lane(fails)) continue;
                for (int left = bits_of(fails); left; left &= left - 1) {
                    int at = x + __builtin_ctz(left);
                    int from = at + nearest > 0 ? at + nearest : 0;
                    int to = at + farthest < width ? at + farthest + 1 : width;
                    if (sees_another(row, at, from, to, direction, tolerance)) validity_out[place + at] = MISMATCH;
                }
            }
        }
    }
}
