// Which right triangles of the pixel lattice must be split for a mesh to stay close to a disparity map.
#include "triangle_error.h"

// A level of the hierarchy of right triangles (Evans, Kirkpatrick and Townsend 2001): of each pair of triangles that
// share a hypotenuse, whether they are split at its middle, the pixel (x, y). The hypotenuses are the diagonals of
// squares of side px, which alternate, or with diagonal = 0 the sides of such squares. A pair is split where a pixel of
// either triangle lies more than error_px from the plane through its corners, where a pixel has no value, where two
// neighbours differ by more than max_jump_px, where it reaches out of the picture, and where one of the pairs that it
// is made of is split, so that no corner ends up within another triangle's side. From the smallest level on; the other
// levels' places of split_out are left as they are.
__kernel void split_triangles(
    // In:
    __global const float *disparity,
    __global const float *corners,
    int width,
    int height,
    int side,
    int diagonal,
    float error_px,
    float max_jump_px,
    // Out:
    __global uchar *split_out)
{
    int i = get_global_id(0), j = get_global_id(1), half_side = side / 2;
    // Half of the hypotenuse, and the way from its middle to the corner at the right angle of one of the triangles.
    int x, y, along_x, along_y, away_x, away_y;
    if (diagonal) {
        int sign = (i + j) & 1 ? 1 : -1;
        x = i * side + half_side;
        y = j * side + half_side;
        along_x = sign * half_side;
        along_y = away_y = -half_side;
        away_x = -sign * half_side;
    } else {
        int upright = j & 1;
        x = i * side + (upright ? 0 : half_side);
        y = j * half_side;
        along_x = away_y = upright ? 0 : -half_side;
        along_y = away_x = upright ? -half_side : 0;
    }
    if (x >= width || y >= height) return;
    split_out[y * width + x] =
        must_split(disparity, corners, split_out, x, y, along_x, along_y, away_x, away_y, width, height, side,
                   diagonal, error_px, max_jump_px) ||
        must_split(disparity, corners, split_out, x, y, -along_x, -along_y, -away_x, -away_y, width, height, side,
                   diagonal, error_px, max_jump_px);
}
