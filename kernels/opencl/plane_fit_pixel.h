// Planes through the surroundings of a pixel that look like it; needs likeness.h.
#define FIT_ENOUGH 3.0f  // sum of weights; fewer neighbours tell no plane
#define FIT_STIFF 0.5f   // pulls the slopes towards 0, in squared px: neighbours on a line tell no slope across it

// A disparity relative to the pixel's own, and slopes.
typedef struct {
    float centre, along_x, along_y;
} Plane;

// Least squares plane through the neighbours near the given one; the weight falls to 0 at the tolerance.
// Rows are summed up first, each from left to right. Returns 0 and leaves the plane where too few are near.
inline int fit_again(
    Plane *plane, __global const float *disparity, __global const uchar *validity, __global const uchar *guide, int x,
    int y, int width, int height, int reach, int step, float tolerance, float slope, float largest_slope)
{
    int pixel = y * width + x, half_way = reach / step;
    float n = 0.0f, sum_x = 0.0f, sum_y = 0.0f, sum_v = 0.0f;
    float sum_xx = 0.0f, sum_xy = 0.0f, sum_yy = 0.0f, sum_xv = 0.0f, sum_yv = 0.0f;
    for (int j = -half_way; j <= half_way; j++) {
        int row = y + j * step;
        if (row < 0 || row >= height) continue;
        float dy = (float)(j * step), surface = plane->centre + plane->along_y * dy;
        float row_n = 0.0f, row_x = 0.0f, row_v = 0.0f;
        for (int i = -half_way; i <= half_way; i++) {
            int column = x + i * step;
            if (column < 0 || column >= width) continue;
            float dx = (float)(i * step), v = disparity[row * width + column] - disparity[pixel];
            float off = v - surface - plane->along_x * dx;
            float allowed = tolerance + slope * (float)furthest(i * step, j * step);
            float near = 1.0f - off * off * (1.0f / (allowed * allowed));
            if (!(near > 0.0f)) continue;
            float weight = neighbour_weight(guide, validity, width * height, pixel, row * width + column);
            weight *= near * near;
            float weighted_x = weight * dx, weighted_v = weight * v;
            row_n += weight;
            row_x += weighted_x;
            row_v += weighted_v;
            sum_xx += weighted_x * dx;
            sum_xv += weighted_v * dx;
        }
        n += row_n;
        sum_x += row_x;
        sum_v += row_v;
        sum_y += row_n * dy;
        sum_xy += row_x * dy;
        sum_yy += row_n * (dy * dy);
        sum_yv += row_v * dy;
    }
    if (!(n >= FIT_ENOUGH)) return 0;
    float one = 1.0f / n, mean_x = sum_x * one, mean_y = sum_y * one, stiff = FIT_STIFF * n;
    float xx = sum_xx - sum_x * mean_x + stiff, yy = sum_yy - sum_y * mean_y + stiff, xy = sum_xy - sum_x * mean_y;
    float xv = sum_xv - sum_v * mean_x, yv = sum_yv - sum_v * mean_y;
    float area = xx * yy - xy * xy;
    if (!(area > 0.0f)) return 0;
    float along_x = (xv * yy - yv * xy) / area, along_y = (yv * xx - xv * xy) / area;
    plane->along_x = along_x <= largest_slope && -along_x <= largest_slope ? along_x : 0.0f;
    plane->along_y = along_y <= largest_slope && -along_y <= largest_slope ? along_y : 0.0f;
    plane->centre = sum_v * one - plane->along_x * mean_x - plane->along_y * mean_y;
    return 1;
}

// One pixel's disparity on its plane; see plane_fit.cl.
inline void fit_pixel(
    __global const float *disparity, __global const uchar *validity, __global const uchar *guide, int x, int y,
    int width, int height, int reach, int step, float tolerance, float slope, float largest_slope,
    __global float *disparity_out)
{
    int pixel = y * width + x;
    float value = disparity[pixel];
    Plane plane = {0.0f, 0.0f, 0.0f};
    if (value == value && !(validity[pixel] & MASKED)) {
        float grows = slope;
        for (int round = 0; round < 2; round++) {
            if (!fit_again(&plane, disparity, validity, guide, x, y, width, height, reach, step, tolerance, grows,
                           largest_slope)) break;
            grows = 0.0f;
        }
    }
    disparity_out[pixel] = plane.centre <= tolerance && -plane.centre <= tolerance ? value + plane.centre : value;
}
