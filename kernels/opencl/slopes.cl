// How the surfaces of a disparity map lean.
#define SAME_SLOPE 0.5f // px a pixel by which the two sides of one surface differ at most

inline float absolute(float v) { return v < 0.0f ? -v : v; }

// The mean of both sides, or the gentler one where they differ; 0 above `largest` or without any side.
inline float slope(float centre, float before, float after, int reach, float largest)
{
    float back = (centre - before) / (float)reach, ahead = (after - centre) / (float)reach;
    float found = absolute(ahead) < absolute(back) ? ahead : back;
    if (absolute(ahead - back) <= SAME_SLOPE) found = 0.5f * (ahead + back);
    if (ahead != ahead) found = back;
    if (back != back) found = ahead;
    return absolute(found) <= largest ? found : 0.0f;
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
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    __global const float *at = disparity + y * width + x;
    float left = x >= reach ? at[-reach] : NAN, right = x + reach < width ? at[reach] : NAN;
    float above = y >= reach ? at[-reach * width] : NAN, below = y + reach < height ? at[reach * width] : NAN;
    along_x_out[y * width + x] = slope(*at, left, right, reach, largest);
    along_y_out[y * width + x] = slope(*at, above, below, reach, largest);
}
