// How the surfaces of a disparity map lean: the form for CPUs, whose work-items take a band of rows each.
#include "lanes.h"
#define SAME_SLOPE 0.5f // px a pixel by which the two sides of one surface differ at most

// Columns x to x + LANES - 1 of a row; outside of the picture NaN.
inline lanes load_or_none(__global const float *row, int x, int width)
{
    if (x >= 0 && x + LANES <= width) return *(__global const lanes *)(row + x);
    lanes some = (lanes)(NAN);
    for (int k = 0; k < LANES; k++)
        if (x + k >= 0 && x + k < width) some[k] = row[x + k];
    return some;
}

// The mean of both sides, or the gentler one where they differ; 0 above `largest` or without any side.
inline lanes slope(lanes centre, lanes before, lanes after, int reach, float largest)
{
    lanes back = (centre - before) / (float)reach, ahead = (after - centre) / (float)reach;
    lanes found = magnitude(ahead) < magnitude(back) ? ahead : back;
    found = magnitude(ahead - back) <= SAME_SLOPE ? 0.5f * (ahead + back) : found;
    found = ahead != ahead ? back : found;
    found = back != back ? ahead : found;
    return magnitude(found) <= largest ? found : 0.0f;
}

// Change of the disparity a pixel, along x and along y: differences over `reach` pixels to either side, the mean of
// both or of the gentler one where they differ by more than SAME_SLOPE. A side outside of the picture or without a
// value does not count. A slope of more than `largest` px a pixel is a depth jump, and 0, as where there is no side.
__kernel void slopes(
    // In:
    __global const float *disparity,
    int width,
    int height,
    int reach,
    float largest,
    // Out:
    __global float *along_x_out,
    __global float *along_y_out)
{
    int2 band = band_of_rows(height);
    for (int y = band.x; y < band.y; y++) {
        long place = (long)y * width, far = (long)reach * width;
        __global const float *row = disparity + place;
        for (int x = 0; x < width; x += LANES) {
            lanes centre = load_or_none(row, x, width);
            lanes left = load_or_none(row, x - reach, width), right = load_or_none(row, x + reach, width);
            lanes above = y >= reach ? load_or_none(row - far, x, width) : (lanes)(NAN);
            lanes below = y + reach < height ? load_or_none(row + far, x, width) : (lanes)(NAN);
            store_lanes(along_x_out + place, x, width, slope(centre, left, right, reach, largest));
            store_lanes(along_y_out + place, x, width, slope(centre, above, below, reach, largest));
        }
    }
}
