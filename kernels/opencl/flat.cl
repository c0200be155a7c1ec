// Find the pixels of flat, textureless surfaces that are better off with the plane of their surroundings.
#include "flat_pixel.h"

// The plane at each pixel, its slopes, and whether it is wanted there.
//
// Planes stand pitch px apart: (4, planes_high, planes_wide) values at their centre, NaN where there is none, slopes
// along x and y, and the share of what lies around that agrees with them. Those of the four centres around a pixel
// are mixed, by distance and share. A plane is wanted where all of this holds: the views agree about less than
// least_agreement of the surroundings, the planes' share is more than least_share, and over a window of 5 x 5 pixels
// the plane explains the pictures about as well as the disparity does, and well at all. What counts is the variance of
// what is left of their difference, so that a difference in brightness changes nothing; noise is that of the pictures'
// noise. plane_out is NaN and slopes are 0 where there is no plane.
__kernel void flat(
    // In:
    __global const float *reference,
    __global const float *other,
    __global const float *planes,
    __global const float *disparity,
    __global const float *agreement,
    int width,
    int height,
    int planes_wide,
    int planes_high,
    int pitch,
    int direction,
    float noise,
    float least_agreement,
    float least_share,
    // Out:
    __global float *plane_out,
    __global float *along_x_out,
    __global float *along_y_out,
    __global uchar *wanted_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    int pixel = y * width + x;
    int before = centre_before(x, pitch), past = halves_from(x, before, pitch);
    int first = clamp_index(before, planes_wide), second = clamp_index(before + 1, planes_wide);
    Column left = column_at(planes, first, y, planes_wide, planes_high, pitch);
    Column right = column_at(planes, second, y, planes_wide, planes_high, pitch);
    float right_weight = (float)past, left_weight = (float)(2 * pitch - past);
    float weight = left_weight * left.weight + right_weight * right.weight;
    if (!(weight > 0.0f)) {
        plane_out[pixel] = NAN;
        along_x_out[pixel] = 0.0f;
        along_y_out[pixel] = 0.0f;
        wanted_out[pixel] = 0;
        return;
    }
    float one = 1.0f / weight;
    float plane = left_weight * (left.value + left.along_x * (0.5f * (float)halves_from(x, first, pitch)));
    plane += right_weight * (right.value + right.along_x * (0.5f * (float)halves_from(x, second, pitch)));
    plane *= one;
    float along_x = (left_weight * left.along_x + right_weight * right.along_x) * one;
    float along_y = (left_weight * left.along_y + right_weight * right.along_y) * one;
    float share = (left_weight * left.share + right_weight * right.share) * one, way = (float)direction;
    int wanted = agreement[pixel] < least_agreement && share > least_share;
    if (wanted) {
        float mine = unexplained(reference, other, x, y, width, height, way, plane, along_x, along_y);
        float u = (float)x + way * plane, given = disparity[pixel];
        wanted = mine <= MOST * noise || u < 0.0f || u > (float)(width - 1);
        if (wanted && given == given) {
            float theirs = unexplained(reference, other, x, y, width, height, way, given, 0.0f, 0.0f);
            wanted = mine <= theirs + WORSE * noise;
        }
    }
    plane_out[pixel] = plane;
    along_x_out[pixel] = along_x;
    along_y_out[pixel] = along_y;
    wanted_out[pixel] = (uchar)wanted;
}
