// Take planes where most of the surroundings want them: the form for CPUs, whose work-items take a band of rows each.
#include "lanes.h"
#include "box_counts.h"

// Add how many pixels of a row want a plane to those of columns from to to - 1, or take them away again; place k of
// the counts is column start + k.
inline void count_row(int *counts, __global const uchar *wanted, int start, int from, int to, int sign)
{
    int x = from;
    for (; x + LANES <= to; x += LANES) {
        int_lanes wants = __builtin_convertvector(*(__global const uchar_lanes *)(wanted + x), int_lanes) != 0;
        // A comparison that holds is -1.
        *(int_lanes *)(counts + x - start) -= wants * sign;
    }
    for (; x < to; x++) counts[x - start] += wanted[x] ? sign : 0;
}

// A pixel takes its plane, where it has one, if at least half of the pixels of the (2 radius + 1)^2 window around it
// that lie in the picture want theirs.
__kernel void majority(
    // In:
    __global const uchar *wanted,
    __global const float *plane,
    __global const float *disparity,
    int width,
    int height,
    int radius,
    // Out:
    __global float *disparity_out,
    __global uchar *taken_out)
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
            if (enters >= 0 && enters < height)
                count_row(counts.columns, wanted + (long)enters * width, start, from, to, 1);
            if (y < band.x) continue;
            // Rows above the band's first window never came in.
            if (leaves >= 0 && leaves >= band.x - radius)
                count_row(counts.columns, wanted + (long)leaves * width, start, from, to, -1);
            int top = y - radius > 0 ? y - radius : 0, bottom = y + radius < height ? y + radius : height - 1;
            int end = left + columns;
            long place = (long)y * width;
            sum_counts(&counts, columns + 2 * radius);
            for (int k = 0; k < columns; k += LANES) {
                int x = left + k;
                int_lanes pixels = window_pixels(x, radius, width, bottom - top + 1);
                int_lanes taken = 2 * window_counts(&counts, k, radius) >= pixels;
                if (x + LANES <= end) {
                    lanes surface = *(__global const lanes *)(plane + place + x);
                    taken &= surface == surface;
                    *(__global lanes *)(disparity_out + place + x) =
                        taken ? surface : *(__global const lanes *)(disparity + place + x);
                    store_reasons(taken_out + place, x, end, taken & 1);
                    continue;
                }
                for (int j = 0; x + j < end; j++) {
                    long pixel = place + x + j;
                    int takes = taken[j] && plane[pixel] == plane[pixel];
                    disparity_out[pixel] = takes ? plane[pixel] : disparity[pixel];
                    taken_out[pixel] = (uchar)takes;
                }
            }
        }
    }
}
