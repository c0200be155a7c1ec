// Gather what pixels say of a surface into square cells: the form for CPUs, whose work-items take a band of rows of
// cells each. Columns of pixels are summed up side by side, then those of a cell one after another.
#include "lanes.h"
#include "cell_weight.h"

// Of each cell of cell x cell pixels: the total weight of its pixels and the weighted means of their columns, their
// rows and their disparities, a plane of the output each; zeros where no pixel counts. A pixel of a value counts from
// an information of `least` (1 / px^2) on, and weighs by it. Columns of pixels are summed up first, each downwards.
__kernel void cells(
    // In:
    __global const float *moved,
    __global const float *information,
    int width,
    int height,
    int cell,
    float least,
    // Out:
    __global float *cells_out)
{
    int cells_wide = (width - 1) / cell + 1, cells_high = (height - 1) / cell + 1;
    long plane = (long)cells_wide * cells_high;
    int2 band = band_of_rows(cells_high);
    float line_n[BLOCK] ALIGNED, line_y[BLOCK] ALIGNED, line_v[BLOCK] ALIGNED;
    for (int row = band.x; row < band.y; row++) {
        int top = row * cell, down = top + cell < height ? cell : height - top;
        __global float *out = cells_out + (long)row * cells_wide;
        // What the cell has so far, and its next column of pixels.
        float n = 0.0f, sum_x = 0.0f, sum_y = 0.0f, sum_v = 0.0f;
        int i = 0, left = 0;
        for (int start = 0; start < width; start += BLOCK) {
            int columns = start + BLOCK < width ? BLOCK : width - start;
            for (int k = 0; k < columns; k += LANES) {
                lanes column_n = 0.0f, column_y = 0.0f, column_v = 0.0f;
                for (int j = 0; j < down; j++) {
                    long place = (long)(top + j) * width;
                    float values[LANES] ALIGNED, tells[LANES] ALIGNED;
                    load_line(values, moved + place, start + k, LANES, width, 0);
                    load_line(tells, information + place, start + k, LANES, width, 0);
                    lanes value = *(lanes *)values, told = *(lanes *)tells;
                    int_lanes counts = value == value && told >= least;
                    lanes weight = counts ? 1.0f / (1.0f / told + LEAST_VARIANCE) : (lanes)(0.0f);
                    column_n += weight;
                    column_y += weight * (float)j;
                    column_v += weight * (counts ? value : (lanes)(0.0f));
                }
                *(lanes *)(line_n + k) = column_n;
                *(lanes *)(line_y + k) = column_y;
                *(lanes *)(line_v + k) = column_v;
            }
            for (int k = 0; k < columns; k++) {
                n += line_n[k];
                sum_x += line_n[k] * (float)i;
                sum_y += line_y[k];
                sum_v += line_v[k];
                if (++i < cell && start + k + 1 < width) continue;
                out[0] = n;
                out[plane] = n > 0.0f ? (float)left + sum_x / n : 0.0f;
                out[2 * plane] = n > 0.0f ? (float)top + sum_y / n : 0.0f;
                out[3 * plane] = n > 0.0f ? sum_v / n : 0.0f;
                out++;
                n = sum_x = sum_y = sum_v = 0.0f;
                i = 0;
                left += cell;
            }
        }
    }
}
