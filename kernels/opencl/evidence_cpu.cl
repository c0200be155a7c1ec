// Step from nearly right disparities to where both pictures fit, and how much they say about it: the form for CPUs.
//
// A work-item owns a band of rows and takes LANES pixels of a row at a time, with stride 2 every other one. Each lane
// samples the other picture at a place of its own, four neighbours that are loaded as one.
#include "lanes.h"
#include "likeness.h"
#include "evidence_pixel.h"
#include "quarters.h"
#define INLINE inline __attribute__((always_inline))
typedef uchar uchar_pairs __attribute__((ext_vector_type(2 * LANES), aligned(1)));
#if LANES == 16
#define EVENS 0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30
#define LOW_PAIRS 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23
#define HIGH_PAIRS 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31
#else
#define EVENS 0, 2, 4, 6, 8, 10, 12, 14
#define LOW_PAIRS 0, 8, 1, 9, 2, 10, 3, 11
#define HIGH_PAIRS 4, 12, 5, 13, 6, 14, 7, 15
#endif

// Columns x, x + stride and so on of a row, stride being 1 or 2; outside of the picture its edge repeated.
INLINE lanes load_every(__global const float *row, int x, int stride, int width)
{
    if (x >= 0 && x + stride * LANES <= width) {
        lanes first = *(__global const lanes *)(row + x);
        if (stride == 1) return first;
        return __builtin_shufflevector(first, *(__global const lanes *)(row + x + LANES), EVENS);
    }
    lanes some;
    for (int k = 0; k < LANES; k++) some[k] = row[clamp_index(x + k * stride, width)];
    return some;
}

// The same of a row of bytes.
INLINE uchar_lanes load_every_byte(__global const uchar *row, int x, int stride, int width)
{
    if (x >= 0 && x + stride * LANES <= width) {
        if (stride == 1) return *(__global const uchar_lanes *)(row + x);
        uchar_pairs pairs = *(__global const uchar_pairs *)(row + x);
        return __builtin_shufflevector(pairs, pairs, EVENS);
    }
    uchar_lanes some;
    for (int k = 0; k < LANES; k++) some[k] = row[clamp_index(x + k * stride, width)];
    return some;
}

// Write every stride-th column from x on, and `beside` between them.
INLINE void store_every(__global float *row, int x, int stride, lanes value, lanes beside)
{
    if (stride == 1) {
        *(__global lanes *)(row + x) = value;
        return;
    }
    *(__global lanes *)(row + x) = __builtin_shufflevector(value, beside, LOW_PAIRS);
    *(__global lanes *)(row + x + LANES) = __builtin_shufflevector(value, beside, HIGH_PAIRS);
}

INLINE uchar_lanes apart(uchar_lanes a, uchar_lanes b) { return (a > b ? a : b) - (a < b ? a : b); }

// a + b, or 255 if that is less
INLINE uchar_lanes add_up(uchar_lanes a, uchar_lanes b)
{
    uchar_lanes room = ~b;
    return (a < room ? a : room) + b;
}

// The same as sample_weight in evidence_pixel.h, for samples that stand at column x of a row of the guide.
INLINE lanes sample_weights(
    const uchar_lanes own[3], __global const uchar *row, long pixels, int x, int stride, int width)
{
    uchar_lanes difference = apart(own[0], load_every_byte(row, x, stride, width));
    difference = add_up(difference, apart(own[1], load_every_byte(row + pixels, x, stride, width)));
    difference = add_up(difference, apart(own[2], load_every_byte(row + 2 * pixels, x, stride, width)));
    uchar_lanes alike = (uchar_lanes)(UNLIKE) - (difference < (uchar_lanes)(UNLIKE) ? difference : (uchar_lanes)(UNLIKE));
    lanes t = __builtin_convertvector(__builtin_convertvector(alike, int_lanes), lanes) * (1.0f / UNLIKE);
    t = t * t;
    t = t * t;
    return t * t;
}

// What evidence_pixel.h computes, for LANES pixels of a row from x on, every stride-th, and what lies between them.
INLINE void evidence_lanes(
    __global const float *reference, __global const float *other, __global const float *disparity,
    __global const float *along_x, __global const float *along_y, __global const uchar *guide, int x, int y, int width,
    int height, int radius, int stride, float way, int weighted, float noise, float damping, float largest_step,
    float keep, __global float *moved_out, __global float *information_out, __global float *residual_out)
{
    long place = (long)y * width, pixels = (long)width * height;
    lanes value = load_every(disparity + place, x, stride, width);
    lanes beside = stride == 1 ? value : load_every(disparity + place, x + 1, stride, width);
    int_lanes given = value == value, own = lane_numbers() * stride + x;
    lanes centre = given ? value : 0.0f;
    lanes slope_x = load_every(along_x + place, x, stride, width);
    lanes slope_y = load_every(along_y + place, x, stride, width);
    uchar_lanes colours[3];
    for (int c = 0; c < 3 && weighted; c++)
        colours[c] = load_every_byte(guide + c * pixels + place, x, stride, width);
    lanes n = 0.0f, sum_g = 0.0f, sum_e = 0.0f, sum_gg = 0.0f, sum_ge = 0.0f, sum_ee = 0.0f;
    for (int j = -radius; j <= radius; j++) {
        if (y + j < 0 || y + j >= height) continue;
        long row = place + (long)j * width;
        lanes across_row = centre + slope_y * (float)j;
        for (int i = -radius; i <= radius; i++) {
            // Counted from x, so that a part of a picture rounds as the whole of it.
            lanes u = (float)i + way * (across_row + slope_x * (float)i), whole = floor_lanes(u);
            int_lanes column = __builtin_convertvector(whole, int_lanes) + own, near = own + i;
            int_lanes counts = near >= 1 & near <= width - 2 & column >= 1 & column <= width - 3;
            lanes share = u - whole, rest = 1.0f - share, t0, t1, t2, t3;
            int_lanes from = column < 1 ? 0 : column - 1;
            load_fours(other + row, from > width - 4 ? width - 4 : from, &t0, &t1, &t2, &t3);
            lanes before = load_every(reference + row, x + i - 1, stride, width);
            lanes here = load_every(reference + row, x + i, stride, width);
            lanes after = load_every(reference + row, x + i + 1, stride, width);
            lanes rise = 0.5f * ((t2 - t0) * rest + (t3 - t1) * share);
            lanes g = 0.5f * (rise + 0.5f * (after - before)), e = here - (t1 * rest + t2 * share);
            lanes weight = 1.0f;
            if (weighted) weight = sample_weights(colours, guide + row, pixels, x + i, stride, width);
            weight = counts ? weight : 0.0f;
            lanes weighted_g = weight * g, weighted_e = weight * e;
            n += weight;
            sum_g += weighted_g;
            sum_e += weighted_e;
            sum_gg += weighted_g * g;
            sum_ge += weighted_g * e;
            sum_ee += weighted_e * e;
        }
    }
    int_lanes tells = given & n >= EVIDENCE_ENOUGH;
    lanes gg = sum_gg - sum_g * sum_g / n, ge = sum_ge - sum_g * sum_e / n, ee = sum_ee - sum_e * sum_e / n;
    gg = gg > 0.0f ? gg : 0.0f;
    lanes step = way * ge / (gg + damping * noise);
    step = step > largest_step ? largest_step : (step < -largest_step ? -largest_step : step);
    lanes left_over = ee - 2.0f * way * step * ge + step * step * gg;
    lanes residual = (left_over > 0.0f ? left_over : 0.0f) / n, information = gg / (2.0f * noise + residual);
    lanes certain = information > 0.0f ? information / (information + keep) : 0.0f;
    store_every(moved_out + place, x, stride, tells ? value + step * certain : value, beside);
    store_every(information_out + place, x, stride, tells ? information : 0.0f, 0.0f);
    store_every(residual_out + place, x, stride, tells ? residual : UNKNOWN, UNKNOWN);
}

// What evidence.cl computes.
__kernel void evidence(
    // In:
    __global const float *reference,
    __global const float *other,
    __global const float *disparity,
    __global const float *along_x,
    __global const float *along_y,
    __global const uchar *guide,
    int width,
    int height,
    int radius,
    int stride,
    int direction,
    int weighted,
    float noise,
    float damping,
    float largest_step,
    float keep,
    // Out:
    __global float *moved_out,
    __global float *information_out,
    __global float *residual_out)
{
    int2 band = band_of_rows(height);
    int span = stride <= 2 ? stride * LANES : width + 1;
    for (int y = band.x; y < band.y; y++) {
        int done = 0;
        if (y % stride != 0) {
            long place = (long)y * width;
            for (; done + LANES <= width; done += LANES) {
                *(__global lanes *)(moved_out + place + done) = *(__global const lanes *)(disparity + place + done);
                *(__global lanes *)(information_out + place + done) = 0.0f;
                *(__global lanes *)(residual_out + place + done) = UNKNOWN;
            }
        } else {
            while (done + stride <= width && span <= width) {
                // The last lanes of a row overlap with those before.
                int x = done + span <= width ? done : (width - span) / stride * stride;
                if (stride == 1)
                    evidence_lanes(
                        reference, other, disparity, along_x, along_y, guide, x, y, width, height, radius, 1,
                        (float)direction, weighted, noise, damping, largest_step, keep, moved_out, information_out,
                        residual_out);
                else
                    evidence_lanes(
                        reference, other, disparity, along_x, along_y, guide, x, y, width, height, radius, 2,
                        (float)direction, weighted, noise, damping, largest_step, keep, moved_out, information_out,
                        residual_out);
                done = x + span;
            }
        }
        for (int x = done; x < width; x++)
            evidence_pixel(
                reference, other, disparity, along_x, along_y, guide, x, y, width, height, radius, stride, direction,
                weighted, noise, damping, largest_step, keep, moved_out, information_out, residual_out);
    }
}
