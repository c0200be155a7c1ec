// Refine disparities by correlating windows that lean with the surface: the form for CPUs.
//
// A work-item owns a band of rows and takes LANES pixels of a row at a time. The windows of all three places are
// correlated in one walk: they share what they see of the reference, and four neighbours in a row of the other
// picture hold what all three sample there, as long as the places are at most a pixel apart.
#include "lanes.h"
#include "slant_pixel.h"
#include "quarters.h"
#define INLINE inline __attribute__((always_inline))
#define FURTHEST_STEP 0.5f

// What one of the three windows has summed up.
typedef struct {
    lanes b, bb, ab;
} Sums;

typedef struct {
    lanes centre, along_x, along_y;
} Planes;

// Columns x to x + LANES - 1 of a row; outside of the picture its edge repeated, or NaN.
INLINE lanes load_lanes(__global const float *row, int x, int width, int repeat)
{
    if (x >= 0 && x + LANES <= width) return *(__global const lanes *)(row + x);
    lanes result;
    for (int k = 0; k < LANES; k++) {
        int inside = clamp_index(x + k, width);
        result[k] = repeat || x + k == inside ? row[inside] : NAN;
    }
    return result;
}

// The same as slope in slant_pixel.h, given the disparities on either side.
INLINE lanes slopes(lanes centre, lanes before, lanes after, float largest)
{
    lanes back = (centre - before) / (float)SLOPE_REACH, ahead = (after - centre) / (float)SLOPE_REACH;
    int_lanes good_back = magnitude(back) <= largest, good_ahead = magnitude(ahead) <= largest;
    lanes gentler = magnitude(ahead) < magnitude(back) ? ahead : back;
    lanes both = magnitude(ahead - back) <= SAME_SLOPE ? 0.5f * (ahead + back) : gentler;
    lanes one = good_back ? back : (good_ahead ? ahead : 0.0f);
    return (good_back & good_ahead) ? both : one;
}

// The same as fit_plane in slant_pixel.h.
INLINE Planes fit_planes(
    __global const float *disparity, int x, int y, lanes centre, float largest_slope, int width, int height)
{
    __global const float *row = disparity + (long)y * width;
    lanes above = y >= SLOPE_REACH ? load_lanes(row - (long)SLOPE_REACH * width, x, width, 0) : (lanes)(NAN);
    lanes below = y + SLOPE_REACH < height ? load_lanes(row + (long)SLOPE_REACH * width, x, width, 0) : (lanes)(NAN);
    lanes left = load_lanes(row, x - SLOPE_REACH, width, 0), right = load_lanes(row, x + SLOPE_REACH, width, 0);
    Planes plane = {centre, slopes(centre, left, right, largest_slope), slopes(centre, above, below, largest_slope)};
    lanes n = 0.0f, sum_x = 0.0f, sum_y = 0.0f, sum_v = 0.0f;
    lanes sum_xx = 0.0f, sum_xy = 0.0f, sum_yy = 0.0f, sum_xv = 0.0f, sum_yv = 0.0f;
    for (int j = -FIT_REACH; j <= FIT_REACH; j++) {
        int near = y + j * FIT_STEP;
        if (near < 0 || near >= height) continue;
        float dy = (float)(j * FIT_STEP);
        for (int i = -FIT_REACH; i <= FIT_REACH; i++) {
            float dx = (float)(i * FIT_STEP);
            lanes v = load_lanes(disparity + (long)near * width, x + i * FIT_STEP, width, 0) - centre;
            int_lanes good = magnitude(v - plane.along_x * dx - plane.along_y * dy) <= SAME_SURFACE;
            lanes one = good ? 1.0f : 0.0f;
            v = good ? v : 0.0f;
            n += one;
            sum_x += one * dx;
            sum_y += one * dy;
            sum_v += v;
            sum_xx += one * (dx * dx);
            sum_xy += one * (dx * dy);
            sum_yy += one * (dy * dy);
            sum_xv += dx * v;
            sum_yv += dy * v;
        }
    }
    lanes xx = sum_xx - sum_x * sum_x / n, xy = sum_xy - sum_x * sum_y / n, yy = sum_yy - sum_y * sum_y / n;
    lanes xv = sum_xv - sum_x * sum_v / n, yv = sum_yv - sum_y * sum_v / n;
    lanes area = xx * yy - xy * xy;
    int_lanes fits = n >= FIT_ENOUGH & area > n * n;
    lanes along_x = (xv * yy - yv * xy) / area, along_y = (yv * xx - xv * xy) / area;
    plane.centre = fits ? centre + (sum_v - along_x * sum_x - along_y * sum_y) / n : centre;
    plane.along_x = fits ? along_x : plane.along_x;
    plane.along_y = fits ? along_y : plane.along_y;
    return plane;
}

#ifdef __AVX512BW__
#define WIDE 1.0e9f
typedef float raw_lanes __attribute__((vector_size(4 * LANES), aligned(4)));
typedef int raw_places __attribute__((vector_size(4 * LANES)));

// The floats at places 0 to 31 of two vectors that lie side by side.
INLINE lanes look_up(raw_lanes left, raw_lanes right, int_lanes place)
{
    return __builtin_astype(__builtin_ia32_vpermi2varps512(left, __builtin_astype(place, raw_places), right), lanes);
}

INLINE float smallest(lanes v)
{
    float8 eight = v.lo < v.hi ? v.lo : v.hi;
    float4 four = eight.lo < eight.hi ? eight.lo : eight.hi;
    float2 two = four.lo < four.hi ? four.lo : four.hi;
    return two.x < two.y ? two.x : two.y;
}
#endif

// Of a row the columns that index tells, and the three to the right of each; beyond the picture its edge repeated.
INLINE void load_four(
    __global const float *row, int_lanes index, int width, int beyond, lanes *t0, lanes *t1, lanes *t2, lanes *t3)
{
    if (!beyond) {
        index = index < 0 ? 0 : index;
        load_fours(row, index > width - 4 ? width - 4 : index, t0, t1, t2, t3);
        return;
    }
    for (int k = 0; k < LANES; k++) {
        (*t0)[k] = row[clamp_index(index[k], width)];
        (*t1)[k] = row[clamp_index(index[k] + 1, width)];
        (*t2)[k] = row[clamp_index(index[k] + 2, width)];
        (*t3)[k] = row[clamp_index(index[k] + 3, width)];
    }
}

// Add a sample that lies share of a pixel to the right of b0.
INLINE void add_sample(Sums *sums, lanes a, lanes b0, lanes b1, lanes share, int_lanes inside)
{
    lanes b = b0 * (1.0f - share) + b1 * share;
    b = inside ? b : 0.0f;
    sums->b += b;
    sums->bb += b * b;
    sums->ab += a * b;
}

// NCC from the sums of a window; see leaning_ncc in slant_pixel.h.
INLINE lanes leaning_scores(Sums sums, lanes count, lanes a, lanes aa, float window)
{
    lanes energy = (aa - a * a / count) * (sums.bb - sums.b * sums.b / count);
    lanes score = (sums.ab - a * sums.b / count) / sqrt(energy);
    return (energy <= 1.0f | count * 3.0f < window) ? 0.0f : score;
}

// What slant.cl computes, for LANES pixels from x on.
INLINE void slant_lanes(
    __global const float *reference, __global const float *other, __global const float *disparity, int x, int y,
    int width, int height, int radius, float way, float step, float largest_slope, __global float *disparity_out,
    __global float *score_out)
{
    long pixel = (long)y * width + x;
    lanes value = *(__global const lanes *)(disparity + pixel);
    int_lanes given = value == value;
    if (!any_lane(given)) {
        *(__global lanes *)(disparity_out + pixel) = value;
        *(__global lanes *)(score_out + pixel) = 0.0f;
        return;
    }
    Planes plane = fit_planes(disparity, x, y, value, largest_slope, width, height);
    // Where there is no disparity, some column of the picture is sampled in vain.
    plane.centre = given ? plane.centre : 0.0f;
    plane.along_x = given ? plane.along_x : 0.0f;
    plane.along_y = given ? plane.along_y : 0.0f;

    lanes lane = __builtin_convertvector(lane_numbers(), lanes), columns = lane + (float)x;
    int_lanes own = lane_numbers() + x;
    lanes count = 0.0f, sum_a = 0.0f, sum_aa = 0.0f;
    Sums low = {0.0f, 0.0f, 0.0f}, middle = low, high = low;
    // The place whose samples lie furthest left, and the one whose lie furthest right.
    float low_shift = -way * step, high_shift = way * step;
    for (int j = -radius; j <= radius; j++) {
        long row = (long)clamp_index(y + j, height) * width;
        lanes across_row = plane.along_y * (float)j;
        // How far to the right of its own column each lane looks, at least and at most, with a pixel to spare for the
        // step and one for rounding.
        lanes first = way * (plane.centre - plane.along_x * (float)radius + across_row);
        lanes last = way * (plane.centre + plane.along_x * (float)radius + across_row);
        lanes least = (first < last ? first : last) - 2.0f, most = (first < last ? last : first) + 2.0f;
        int beyond = any_lane(given & (columns - (float)radius + least < 0.0f
                                       | columns + (float)radius + most > (float)(width - 4)));
#ifdef __AVX512BW__
        // On a smooth surface all lanes sample among the same two vectors.
        least = given ? lane + least : WIDE;
        most = given ? lane + most : -WIDE;
        int start = floor_to_int(smallest(least));
        int near_by = !beyond && -smallest(-most) < (float)(start + 2 * LANES - 4)
                      && row + x + radius + start + 2 * LANES <= (long)width * height;
#endif
        for (int i = -radius; i <= radius; i++) {
            lanes surface = plane.centre + plane.along_x * (float)i + across_row;
            lanes near = load_lanes(disparity + row, x + i, width, 1);
            int_lanes inside = magnitude(near - surface) <= SAME_SURFACE;
            lanes a = load_lanes(reference + row, x + i, width, 1);
            a = inside ? a : 0.0f;
            count += inside ? 1.0f : 0.0f;
            sum_a += a;
            sum_aa += a * a;
            // Counted from x, so that a part of a picture rounds as the whole of it.
            float at = (float)i;
            lanes u_low = at + way * (surface + low_shift), u = at + way * surface;
            lanes u_high = at + way * (surface + high_shift);
            lanes whole = floor_lanes(u_low), next = whole + 1.0f, after = whole + 2.0f;
            int_lanes index = __builtin_convertvector(whole, int_lanes) + own;
            lanes t0, t1, t2, t3;
#ifdef __AVX512BW__
            if (near_by) {
                int from = x + i + start;
                raw_lanes left = *(__global const raw_lanes *)(other + row + from);
                raw_lanes right = *(__global const raw_lanes *)(other + row + from + LANES);
                t0 = look_up(left, right, index - from);
                t1 = look_up(left, right, index - from + 1);
                t2 = look_up(left, right, index - from + 2);
                t3 = look_up(left, right, index - from + 3);
            } else
#endif
                load_four(other + row, index, width, beyond, &t0, &t1, &t2, &t3);
            add_sample(&low, a, t0, t1, u_low - whole, inside);
            int_lanes moved = u >= next;
            add_sample(&middle, a, moved ? t1 : t0, moved ? t2 : t1, u - (moved ? next : whole), inside);
            int_lanes once = u_high >= next, twice = u_high >= after;
            lanes b0 = twice ? t2 : (once ? t1 : t0), b1 = twice ? t3 : (once ? t2 : t1);
            add_sample(&high, a, b0, b1, u_high - (twice ? after : (once ? next : whole)), inside);
        }
    }
    float window = (float)((2 * radius + 1) * (2 * radius + 1));
    lanes here = leaning_scores(middle, count, sum_a, sum_aa, window);
    lanes score_low = leaning_scores(low, count, sum_a, sum_aa, window);
    lanes score_high = leaning_scores(high, count, sum_a, sum_aa, window);
    lanes below = way > 0.0f ? score_low : score_high, above = way > 0.0f ? score_high : score_low;
    int_lanes peak = here >= below & here >= above;
    lanes bend = (below - here) + (above - here);
    lanes vertex = bend < 0.0f ? 0.5f * (below - above) / bend : 0.0f;
    lanes moved = peak ? vertex : (below >= above ? -1.0f : 1.0f);
    lanes best = peak ? here : (below >= above ? below : above);
    int_lanes unsure = best < SURE;
    moved = unsure ? 0.0f : moved;
    best = unsure ? here : best;
    *(__global lanes *)(disparity_out + pixel) = given ? plane.centre + moved * step : value;
    *(__global lanes *)(score_out + pixel) = (given & (best > 0.0f)) ? best : 0.0f;
}

// What slant.cl computes.
__kernel void slant(
    // In:
    __global const float *reference,
    __global const float *other,
    __global const float *disparity,
    int width,
    int height,
    int radius,
    int direction,
    float step,
    float largest_slope,
    // Out:
    __global float *disparity_out,
    __global float *score_out)
{
    int2 rows = band_of_rows(height);
    for (int y = rows.x; y < rows.y; y++) {
        if (width < LANES || step > FURTHEST_STEP || step < 0.0f) {
            for (int x = 0; x < width; x++)
                slant_pixel(
                    reference, other, disparity, x, y, width, height, radius, direction, step, largest_slope,
                    disparity_out, score_out);
        } else {
            // The last lanes of a row overlap with those before.
            for (int x = 0; x < width; x += LANES)
                slant_lanes(
                    reference, other, disparity, x + LANES <= width ? x : width - LANES, y, width, height, radius,
                    (float)direction, step, largest_slope, disparity_out, score_out);
        }
    }
}
