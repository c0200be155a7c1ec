// Fit robust planes through the cells around them.
#include "robust_plane.h"

// A plane stands in the middle of every block of spacing x spacing cells, and is a least squares fit through the
// cells within `reach` of it. Cells weigh by their own weight and (1 - r^2 / R^2)^3 at a distance of r of R px, and
// from the second of four fits on by (1 / (1 + (e / scale)^2))^2 where they are e px off the plane (Geman and McClure
// 1987), with scales of 4, 2 and 1 px. Of each plane its value in its middle, its slopes along x and y, and the
// weight of the cells within tolerance px of it over the weight of all, a plane of the output each; NaN and zeros
// where no cell is near.
__kernel void planes(
    // In:
    __global const float *cells,
    int cells_wide,
    int cells_high,
    int planes_wide,
    int planes_high,
    int cell,
    int spacing,
    int reach,
    float tolerance,
    // Out:
    __global float *planes_out)
{
    int column = get_global_id(0), row = get_global_id(1);
    if (column >= planes_wide || row >= planes_high) return;
    fit_plane(cells, cells_wide, cells_high, planes_wide, planes_high, column, row, cell, spacing, reach, tolerance,
              planes_out);
}
