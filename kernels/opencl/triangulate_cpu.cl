// Disparity to points in space: the form for CPUs. A work-item owns a band of rows and takes LANES pixels at a time.
#include "lanes.h"

// Write the x, y and z of LANES points in turn.
inline void store_points(__global float *points, lanes x, lanes y, lanes z)
{
#if !defined(__AVX2__)
    for (int k = 0; k < LANES; k++) {
        points[3 * k] = x[k];
        points[3 * k + 1] = y[k];
        points[3 * k + 2] = z[k];
    }
#elif LANES == 16
    // Of the first vector every third float is an x, and so on; 0 to 15 are lanes of the one, 16 to 31 of the other.
    lanes first = __builtin_shufflevector(x, y, 0, 16, 0, 1, 17, 0, 2, 18, 0, 3, 19, 0, 4, 20, 0, 5);
    lanes second = __builtin_shufflevector(x, y, 21, 0, 6, 22, 0, 7, 23, 0, 8, 24, 0, 9, 25, 0, 10, 26);
    lanes third = __builtin_shufflevector(x, y, 0, 11, 27, 0, 12, 28, 0, 13, 29, 0, 14, 30, 0, 15, 31, 0);
    *(__global lanes *)points =
        __builtin_shufflevector(first, z, 0, 1, 16, 3, 4, 17, 6, 7, 18, 9, 10, 19, 12, 13, 20, 15);
    *(__global lanes *)(points + 16) =
        __builtin_shufflevector(second, z, 0, 21, 2, 3, 22, 5, 6, 23, 8, 9, 24, 11, 12, 25, 14, 15);
    *(__global lanes *)(points + 32) =
        __builtin_shufflevector(third, z, 26, 1, 2, 27, 4, 5, 28, 7, 8, 29, 10, 11, 30, 13, 14, 31);
#else
    lanes first = __builtin_shufflevector(x, y, 0, 8, 0, 1, 9, 0, 2, 10);
    lanes second = __builtin_shufflevector(x, y, 0, 3, 11, 0, 4, 12, 0, 5);
    lanes third = __builtin_shufflevector(x, y, 13, 0, 6, 14, 0, 7, 15, 0);
    *(__global lanes *)points = __builtin_shufflevector(first, z, 0, 1, 8, 3, 4, 9, 6, 7);
    *(__global lanes *)(points + 8) = __builtin_shufflevector(second, z, 10, 1, 2, 11, 4, 5, 12, 7);
    *(__global lanes *)(points + 16) = __builtin_shufflevector(third, z, 0, 13, 2, 3, 14, 5, 6, 15);
#endif
}

// What triangulate.cl computes.
__kernel void triangulate(
    // In:
    __global const float *disparity,
    int width,
    int height,
    int direction,
    float focal_px,
    float baseline,
    float cx_left,
    float cx_right,
    float cy,
    // Out:
    __global float *points_out)
{
    int2 rows = band_of_rows(height);
    float shift = cx_left - cx_right;
    for (int y = rows.x; y < rows.y; y++) {
        __global const float *row = disparity + (long)y * width;
        __global float *points = points_out + (long)y * width * 3;
        float down = (float)y - cy;
        int x = 0;
        for (; x + LANES <= width; x += LANES) {
            lanes value = *(__global const lanes *)(row + x);
            lanes column = __builtin_convertvector(lane_numbers() + x, lanes);
            lanes parallax = value - shift;
            int_lanes seen = parallax > 0.0f;
            lanes x_left = direction > 0 ? column + value : column;
            lanes scale = baseline / parallax;
            scale = seen ? scale : NAN;
            store_points(points + x * 3, (x_left - cx_left) * scale, down * scale, focal_px * scale);
        }
        for (; x < width; x++) {
            float parallax = row[x] - shift;
            float x_left = direction > 0 ? (float)x + row[x] : (float)x;
            float scale = parallax > 0.0f ? baseline / parallax : NAN;
            points[x * 3] = (x_left - cx_left) * scale;
            points[x * 3 + 1] = down * scale;
            points[x * 3 + 2] = focal_px * scale;
        }
    }
}
