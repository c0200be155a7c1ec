// How much of what lies around a pixel both views agree about: the form for CPUs, whose work-items take a band of
// rows each.
#include "lanes.h"
#include "box_counts.h"

// Add how many pixels of a row count to those of columns from to to - 1, or take them away again; place k of the
// counts is column start + k.
inline void count_row(
    int *counts, __global const float *checked, __global const uchar *taken, int start, int from, int to, int sign)
{
    int x = from;
    for (; x + LANES <= to; x += LANES) {
        lanes value = *(__global const lanes *)(checked + x);
        int_lanes free = __builtin_convertvector(*(__global const uchar_lanes *)(taken + x), int_lanes) == 0;
        // A comparison that holds is -1.
        *(int_lanes *)(counts + x - start) -= (value == value & free) * sign;
    }
    for (; x < to; x++) counts[x - start] += checked[x] == checked[x] && !taken[x] ? sign : 0;
}

// Share of the pixels of the (2 radius + 1)^2 window, of which those outside of the picture do not count, that have a
// value in checked, which is NaN where the views disagree, and are not taken.
__kernel void agreement(
    // In:
    __global const float *checked,
    __global const uchar *taken,
    int width,
    int height,
    int radius,
    // Out:
    __global float *agreement_out)
{
    int2 band = band_of_rows(height);
    int room = box_columns(radius);
    BoxCounts counts;
    for (int left = 0; left < width; left += room) {
        int columns = left + room < width ? room : width - left, start = left - radius;
        int from = start > 0 ? start : 0, to = left + columns + radius < width ? left + columns + radius : width;
        clear_counts(&counts, columns + 2 * radius);
        for (int y = band.x - 2 * radius; y < band.y; y++) {
            // The row that enters the window of row y, and the one that leaves it.
            int enters = y + radius, leaves = y - radius - 1;
            if (enters >= 0 && enters < height) {
                long row = (long)enters * width;
                count_row(counts.columns, checked + row, taken + row, start, from, to, 1);
            }
            if (y < band.x) continue;
            // Rows above the band's first window never came in.
            if (leaves >= 0 && leaves >= band.x - radius) {
                long row = (long)leaves * width;
                count_row(counts.columns, checked + row, taken + row, start, from, to, -1);
            }
            int top = y - radius > 0 ? y - radius : 0, bottom = y + radius < height ? y + radius : height - 1;
            sum_counts(&counts, columns + 2 * radius);
            for (int k = 0; k < columns; k += LANES) {
                lanes good = __builtin_convertvector(window_counts(&counts, k, radius), lanes);
                int_lanes pixels = window_pixels(left + k, radius, width, bottom - top + 1);
                store_lanes(agreement_out + (long)y * width, left + k, left + columns,
                            good / __builtin_convertvector(pixels, lanes));
            }
        }
    }
}
