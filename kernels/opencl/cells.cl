// Gather what pixels say of a surface into square cells.
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
    int column = get_global_id(0), row = get_global_id(1);
    int cells_wide = (width - 1) / cell + 1, cells_high = (height - 1) / cell + 1;
    if (column >= cells_wide || row >= cells_high) return;
    int left = column * cell, top = row * cell;
    int across = left + cell < width ? cell : width - left, down = top + cell < height ? cell : height - top;
    float n = 0.0f, sum_x = 0.0f, sum_y = 0.0f, sum_v = 0.0f;
    for (int i = 0; i < across; i++) {
        float column_n = 0.0f, column_y = 0.0f, column_v = 0.0f;
        for (int j = 0; j < down; j++) {
            long pixel = (long)(top + j) * width + left + i;
            float value = moved[pixel];
            if (value != value || !(information[pixel] >= least)) continue;
            float weight = 1.0f / (1.0f / information[pixel] + LEAST_VARIANCE);
            column_n += weight;
            column_y += weight * (float)j;
            column_v += weight * value;
        }
        n += column_n;
        sum_x += column_n * (float)i;
        sum_y += column_y;
        sum_v += column_v;
    }
    __global float *out = cells_out + (long)row * cells_wide + column;
    long plane = (long)cells_wide * cells_high;
    out[0] = n;
    out[plane] = n > 0.0f ? (float)left + sum_x / n : 0.0f;
    out[2 * plane] = n > 0.0f ? (float)top + sum_y / n : 0.0f;
    out[3 * plane] = n > 0.0f ? sum_v / n : 0.0f;
}
