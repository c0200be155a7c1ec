// Move disparities onto the plane through those surroundings that look alike: the form for CPUs, whose work-items take
// a band of rows each.
#include "lanes.h"
#include "likeness.h"
#include "plane_fit_pixel.h"
#include "guide_lanes.h"
#define FAR 1.0e18f // stands for no disparity: from any plane so far that it weighs 0, and 0 times it is 0

typedef struct {
    lanes centre, along_x, along_y;
} Planes;

// What weighs the neighbours of SPAN pixels, LANES to a vector.
typedef lanes Weights[MOST_ACROSS * MOST_ACROSS][GROUP];

// How much the neighbours weigh for their own sake, in both rounds: what looks alike counts.
inline void weigh(lanes (*weights)[GROUP], const Lines *lines, int own, int first, int last, int half_way, int step)
{
    int margin = half_way * step;
    bytes a = *(bytes *)(lines->guide[own][0] + margin), b = *(bytes *)(lines->guide[own][1] + margin);
    bytes c = *(bytes *)(lines->guide[own][2] + margin);
    for (int j = first; j <= last; j++) {
        for (int i = 0; i <= 2 * half_way; i++) {
            bytes like = alike(lines, j - first, i * step, a, b, c);
            const uchar_lanes *quarter = (const uchar_lanes *)&like;
            UNROLL for (int k = 0; k < GROUP; k++) (*weights)[k] = likenesses(quarter[k]);
            weights++;
        }
    }
}

// The same as fit_again in plane_fit_pixel.h, for pixels whose neighbours stand at `lines`; where `may` holds.
inline __attribute__((always_inline)) int_lanes fit_again_lanes(
    Planes *plane, int_lanes may, const lanes (*weights)[GROUP], const float (*line)[LINE], lanes value, int first,
    int last, int half_way, int step, float tolerance, float slope, float largest_slope)
{
    lanes n = 0.0f, sum_x = 0.0f, sum_y = 0.0f, sum_v = 0.0f;
    lanes sum_xx = 0.0f, sum_xy = 0.0f, sum_yy = 0.0f, sum_xv = 0.0f, sum_yv = 0.0f;
    for (int j = first; j <= last; j++, line++) {
        float dy = (float)(j * step);
        lanes surface = plane->centre + plane->along_y * dy;
        lanes row_n = 0.0f, row_x = 0.0f, row_v = 0.0f;
        for (int i = -half_way; i <= half_way; i++, weights++) {
            float dx = (float)(i * step), allowed = tolerance + slope * (float)furthest(i * step, j * step);
            lanes v = *(const lanes *)(*line + (half_way + i) * step) - value;
            lanes off = v - surface - plane->along_x * dx;
            lanes near = 1.0f - off * off * (1.0f / (allowed * allowed));
            near = near > 0.0f ? near : 0.0f;
            lanes weight = (*weights)[0] * (near * near), weighted_x = weight * dx, weighted_v = weight * v;
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
    lanes one = 1.0f / n, mean_x = sum_x * one, mean_y = sum_y * one, stiff = FIT_STIFF * n;
    lanes xx = sum_xx - sum_x * mean_x + stiff, yy = sum_yy - sum_y * mean_y + stiff, xy = sum_xy - sum_x * mean_y;
    lanes xv = sum_xv - sum_v * mean_x, yv = sum_yv - sum_v * mean_y;
    lanes area = xx * yy - xy * xy;
    int_lanes fits = may & n >= FIT_ENOUGH & area > 0.0f;
    lanes along_x = (xv * yy - yv * xy) / area, along_y = (yv * xx - xv * xy) / area;
    along_x = magnitude(along_x) <= largest_slope ? along_x : 0.0f;
    along_y = magnitude(along_y) <= largest_slope ? along_y : 0.0f;
    plane->centre = fits ? sum_v * one - along_x * mean_x - along_y * mean_y : plane->centre;
    plane->along_x = fits ? along_x : plane->along_x;
    plane->along_y = fits ? along_y : plane->along_y;
    return fits;
}

// Least squares plane through the pixels around each (within reach, every step-th), in two rounds: through those
// within tolerance px of the pixel's own disparity, where the tolerance grows by slope px with each row or column of
// distance, then through those within tolerance of that plane. Neighbours weigh by how near they are to it
// (Tukey 1977) and by how much they look like the pixel in the guide, three planes of bytes; masked ones not at all.
// A slope of more than largest_slope px a pixel is a depth jump. No disparity moves by more than tolerance.
__kernel void plane_fit(
    // In:
    __global const float *disparity,
    __global const uchar *validity,
    __global const uchar *guide,
    int width,
    int height,
    int reach,
    int step,
    float tolerance,
    float slope,
    float largest_slope,
    // Out:
    __global float *disparity_out)
{
    int2 band = band_of_rows(height);
    int half_way = reach / step, margin = half_way * step;
    int lines_hold = margin <= MARGIN && 2 * half_way < MOST_ACROSS;
    Lines lines;
    Weights weights;
    for (int y = band.x; y < band.y; y++) {
        int above_us = y / step, below_us = (height - 1 - y) / step;
        int first = above_us < half_way ? -above_us : -half_way, last = below_us < half_way ? below_us : half_way;
        long place = (long)y * width;
        for (int start = 0; start < width; start += SPAN) {
            if (!lines_hold) {
                for (int x = start; x < width && x < start + SPAN; x++)
                    fit_pixel(disparity, validity, guide, x, y, width, height, reach, step, tolerance, slope,
                              largest_slope, disparity_out);
                continue;
            }
            load_neighbours(&lines, disparity, validity, guide, start, y, width, height, first, last, step, margin);
            lanes values[GROUP];
            UNROLL for (int k = 0; k < GROUP; k++) values[k] = *(lanes *)(lines.disparity[-first] + margin + k * LANES);
            for (int j = 0; j <= last - first; j++) {
                for (int k = 0; k < SPAN + 2 * margin; k += LANES) {
                    lanes *some = (lanes *)(lines.disparity[j] + k);
                    *some = *some == *some ? *some : FAR;
                }
            }
            weigh(weights, &lines, -first, first, last, half_way, step);
            for (int k = 0; k < GROUP; k++) {
                int x = start + k * LANES;
                if (x >= width) break;
                lanes value = values[k];
                int_lanes fits = (load_reasons(validity + place, x, width) & MASKED) == 0 & value == value;
                if (any_lane(fits)) {
                    Planes plane = {0.0f, 0.0f, 0.0f};
                    const lanes (*ours)[GROUP] = (const lanes (*)[GROUP])(&weights[0][k]);
                    const float (*line)[LINE] = (const float (*)[LINE])(&lines.disparity[0][k * LANES]);
                    fits = fit_again_lanes(&plane, fits, ours, line, value, first, last, half_way, step, tolerance, slope,
                                           largest_slope);
                    fit_again_lanes(&plane, fits, ours, line, value, first, last, half_way, step, tolerance, 0.0f,
                                    largest_slope);
                    value = magnitude(plane.centre) <= tolerance ? value + plane.centre : value;
                }
                store_lanes(disparity_out + place, x, width, value);
            }
        }
    }
}
