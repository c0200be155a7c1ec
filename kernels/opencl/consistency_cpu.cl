// Left-right check: the form for CPUs, whose work-items take a band of rows each.
//
// What needs an address from each lane is done one by one between loops over vectors, which leave and find it in
// arrays. Which pixels some winner of the other view points back at is marked once a row, so that the verdict does
// not search the disparities.
#include "lanes.h"
#include "peaks.h"
#define OCCLUDED 4
#define MISMATCH 8
#define HELD 4096 // columns whose marks are held at a time

// The column of the other view that each value points at; column 0 where there is no value.
inline int_lanes partner(lanes value, int_lanes x, int direction)
{
    lanes nearest = floor_lanes((value == value ? value : (lanes)(0.0f)) + 0.5f);
    return value == value ? x + direction * __builtin_convertvector(nearest, int_lanes) : (int_lanes)(0);
}

inline int_lanes load_keys(__global const int *row, int x, int width)
{
    if (x + LANES <= width) return *(__global const int_lanes *)(row + x);
    int_lanes keys = (int_lanes)(0);
    for (int j = 0; x + j < width; j++) keys[j] = row[x + j];
    return keys;
}

// Take a disparity away where the other view's winner differs from it by more than tolerance px.
// other holds winner_key. After Hirschmueller (PAMI 2008): a pixel is a mismatch if some disparity would have
// agreed with the other view, else it is occluded, as is one whose match lies outside of the other picture.
__kernel void consistency(
    // In:
    __global const float *disparity,
    __global const int *other,
    __global const uchar *validity,
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
    int bits = index_bits(disparities), mask = (1 << bits) - 1;
    // How far from a pixel the columns lie that may point back at it.
    int one = direction * smallest, two = direction * (smallest + disparities - 1);
    int nearest = one < two ? one : two, farthest = one < two ? two : one;
    int_lanes counting = lane_numbers();
    int places[BLOCK] ALIGNED, keys[BLOCK] ALIGNED;
    float values[BLOCK] ALIGNED;
    uchar pointed_at[HELD + LANES] ALIGNED; // and one place for those that point elsewhere
    for (int y = band.x; y < band.y; y++) {
        __global const int *winners = other + (long)y * width;
        for (int left = 0; left < width; left += HELD) {
            int held = left + HELD < width ? HELD : width - left;
            for (int k = 0; k < held; k += LANES) *(uchar_lanes *)(pointed_at + k) = (uchar_lanes)(0);
            int from = left + nearest > 0 ? left + nearest : 0;
            int to = left + held + farthest < width ? left + held + farthest : width;
            for (int u = from; u < to; u += BLOCK) {
                int columns = u + BLOCK < to ? BLOCK : to - u;
                for (int k = 0; k < columns; k += LANES) {
                    int_lanes key = load_keys(winners, u + k, width), index = mask - (key & mask);
                    int_lanes x = counting + (u + k - left) - direction * (smallest + index);
                    int_lanes points = key > 0 && index < disparities && x >= 0 && x < held;
                    *(int_lanes *)(places + k) = points ? x : (int_lanes)(HELD);
                }
                for (int k = 0; k < columns; k++) pointed_at[places[k]] = 1;
            }
            for (int start = left; start < left + held; start += BLOCK) {
                int columns = start + BLOCK < left + held ? BLOCK : left + held - start;
                load_line(values, disparity + (long)y * width, start, columns, width, 0);
                for (int k = 0; k < columns; k += LANES) {
                    int_lanes u = partner(*(lanes *)(values + k), counting + (start + k), direction);
                    // The sub-pixel part may round to one pixel past the edge.
                    int_lanes inside = u < 0 ? (int_lanes)(0) : u;
                    *(int_lanes *)(places + k) = inside < width ? inside : (int_lanes)(width - 1);
                }
                for (int k = 0; k < (columns + LANES - 1) / LANES * LANES; k++) keys[k] = winners[places[k]];
                for (int k = 0; k < columns; k += LANES) {
                    lanes value = *(lanes *)(values + k);
                    int_lanes key = *(int_lanes *)(keys + k), u = partner(value, counting + (start + k), direction);
                    int_lanes back = smallest + (mask - (key & mask)), outside = u < -1 || u > width;
                    int_lanes agrees = key > 0 && magnitude(__builtin_convertvector(back, lanes) - value) <= tolerance;
                    int_lanes fails = value == value && (outside || !agrees);
                    int_lanes marked =
                        __builtin_convertvector(*(uchar_lanes *)(pointed_at + start - left + k), int_lanes) != 0;
                    int_lanes reasons = load_reasons(validity + (long)y * width, start + k, width);
                    reasons = !fails ? reasons : marked && !outside ? (int_lanes)(MISMATCH) : (int_lanes)(OCCLUDED);
                    store_lanes(disparity_out + (long)y * width, start + k, width, fails ? (lanes)(NAN) : value);
                    store_reasons(validity_out + (long)y * width, start + k, width, reasons);
                }
            }
        }
    }
}
