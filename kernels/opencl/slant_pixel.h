// One pixel of slant: a plane through the map around it, and the NCC of a window that leans with it.
#define SLOPE_REACH 6
#define FIT_REACH 3
#define FIT_STEP 2
#define FIT_ENOUGH 12.0f
#define SAME_SLOPE 0.5f
#define SAME_SURFACE 1.0f
#define SURE 0.7f

// Disparity at a pixel, and its change a pixel along x and y.
typedef struct {
    float centre, along_x, along_y;
} Plane;

inline float absolute(float v) { return v < 0.0f ? -v : v; }

// Disparity change a pixel along one axis: the mean of both sides, or of the gentler one where they differ.
// A side that leaves the picture, has no value or rises by more than largest px a pixel does not count.
inline float slope(__global const float *disparity, int start, int at, int size, int stride, float largest)
{
    float centre = disparity[start + at * stride], back = NAN, ahead = NAN;
    if (at >= SLOPE_REACH) back = (centre - disparity[start + (at - SLOPE_REACH) * stride]) / (float)SLOPE_REACH;
    if (at + SLOPE_REACH < size)
        ahead = (disparity[start + (at + SLOPE_REACH) * stride] - centre) / (float)SLOPE_REACH;
    int good_back = absolute(back) <= largest, good_ahead = absolute(ahead) <= largest;
    if (good_back && good_ahead) {
        if (absolute(ahead - back) <= SAME_SLOPE) return 0.5f * (ahead + back);
        return absolute(ahead) < absolute(back) ? ahead : back;
    }
    return good_back ? back : good_ahead ? ahead : 0.0f;
}

// Disparity at (x, y) and slopes of the least squares plane through the pixels around that lie near one.
// Near the plane through (x, y) with slopes along_x and along_y; that plane itself where too few do.
inline Plane fit_plane(
    __global const float *disparity, int x, int y, float along_x, float along_y, int width, int height)
{
    float centre = disparity[y * width + x];
    float n = 0.0f, sum_x = 0.0f, sum_y = 0.0f, sum_v = 0.0f;
    float sum_xx = 0.0f, sum_xy = 0.0f, sum_yy = 0.0f, sum_xv = 0.0f, sum_yv = 0.0f;
    for (int j = -FIT_REACH; j <= FIT_REACH; j++) {
        for (int i = -FIT_REACH; i <= FIT_REACH; i++) {
            int row = y + j * FIT_STEP, column = x + i * FIT_STEP;
            if (row < 0 || row >= height || column < 0 || column >= width) continue;
            float dx = (float)(i * FIT_STEP), dy = (float)(j * FIT_STEP);
            float v = disparity[row * width + column] - centre;
            if (!(absolute(v - along_x * dx - along_y * dy) <= SAME_SURFACE)) continue;
            n += 1.0f;
            sum_x += dx;
            sum_y += dy;
            sum_v += v;
            sum_xx += dx * dx;
            sum_xy += dx * dy;
            sum_yy += dy * dy;
            sum_xv += dx * v;
            sum_yv += dy * v;
        }
    }
    Plane plane = {centre, along_x, along_y};
    if (n < FIT_ENOUGH) return plane;
    float xx = sum_xx - sum_x * sum_x / n, xy = sum_xy - sum_x * sum_y / n, yy = sum_yy - sum_y * sum_y / n;
    float xv = sum_xv - sum_x * sum_v / n, yv = sum_yv - sum_y * sum_v / n;
    float area = xx * yy - xy * xy;
    // Pixels on one line tell no slope across it.
    if (area > n * n) {
        plane.along_x = (xv * yy - yv * xy) / area;
        plane.along_y = (yv * xx - xv * xy) / area;
        plane.centre = centre + (sum_v - plane.along_x * sum_x - plane.along_y * sum_y) / n;
    }
    return plane;
}

// NCC of the pixels around (x, y) that lie on a plane of disparity, with the plane moved by shift px.
// Pixels whose own disparity is further than SAME_SURFACE from the plane belong to another surface. 0 where
// the window is flat or holds less than a third of its pixels: a handful correlates with anything.
inline float leaning_ncc(
    __global const float *reference, __global const float *other, __global const float *disparity, int x, int y,
    Plane plane, float shift, int width, int height, int radius, float direction)
{
    float count = 0.0f, sum_a = 0.0f, sum_b = 0.0f, sum_aa = 0.0f, sum_bb = 0.0f, sum_ab = 0.0f;
    for (int j = -radius; j <= radius; j++) {
        int row = clamp_index(y + j, height) * width;
        for (int i = -radius; i <= radius; i++) {
            int at = row + clamp_index(x + i, width);
            float surface = plane.centre + plane.along_x * (float)i + plane.along_y * (float)j;
            if (!(absolute(disparity[at] - surface) <= SAME_SURFACE)) continue;
            float a = reference[at];
            // Counted from x, so that a part of a picture rounds as the whole of it.
            float u = (float)i + direction * (surface + shift);
            int column = floor_to_int(u);
            float share = u - (float)column;
            column += x;
            float b = other[row + clamp_index(column, width)] * (1.0f - share);
            b += other[row + clamp_index(column + 1, width)] * share;
            count += 1.0f;
            sum_a += a;
            sum_b += b;
            sum_aa += a * a;
            sum_bb += b * b;
            sum_ab += a * b;
        }
    }
    float energy = (sum_aa - sum_a * sum_a / count) * (sum_bb - sum_b * sum_b / count);
    float window = (float)((2 * radius + 1) * (2 * radius + 1));
    return energy <= 1.0f || count * 3.0f < window ? 0.0f : (sum_ab - sum_a * sum_b / count) / sqrt(energy);
}

// Disparity at the peak of the NCC over step px around one pixel, and the NCC there; see slant.cl.
inline void slant_pixel(
    __global const float *reference, __global const float *other, __global const float *disparity, int x, int y,
    int width, int height, int radius, int direction, float step, float largest_slope,
    __global float *disparity_out, __global float *score_out)
{
    int pixel = y * width + x;
    float value = disparity[pixel];
    disparity_out[pixel] = value;
    score_out[pixel] = 0.0f;
    if (value != value) return;
    float along_x = slope(disparity, y * width, x, width, 1, largest_slope);
    float along_y = slope(disparity, x, y, height, width, largest_slope);
    Plane plane = fit_plane(disparity, x, y, along_x, along_y, width, height);
    float way = (float)direction;
    float here = leaning_ncc(reference, other, disparity, x, y, plane, 0.0f, width, height, radius, way);
    float below = leaning_ncc(reference, other, disparity, x, y, plane, -step, width, height, radius, way);
    float above = leaning_ncc(reference, other, disparity, x, y, plane, step, width, height, radius, way);
    float moved = 0.0f, best = here;
    if (here >= below && here >= above) {
        float bend = (below - here) + (above - here);
        if (bend < 0.0f) moved = 0.5f * (below - above) / bend;
    } else {
        moved = below >= above ? -1.0f : 1.0f;
        best = below >= above ? below : above;
    }
    if (best < SURE) {
        moved = 0.0f;
        best = here;
    }
    disparity_out[pixel] = plane.centre + moved * step;
    score_out[pixel] = best > 0.0f ? best : 0.0f;
}
