// Step from nearly right disparities to where both pictures fit, and how much they say about it: the form for CPUs.
//
// A work-item owns a band of rows and takes LANES pixels of a row at a time, with stride 2 every other one. Each lane
// samples the other picture at a place of its own: four neighbours, which on a smooth surface are looked up in the same
// few vectors for all lanes, and loaded as one where they lie far apart.
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

// LANES numbers, stride places apart, which is 1 or 2.
INLINE lanes load_apart(__global const float *from, int stride)
{
    lanes first = *(__global const lanes *)from;
    if (stride == 1) return first;
    return __builtin_shufflevector(first, *(__global const lanes *)(from + LANES), EVENS);
}

INLINE uchar_lanes load_bytes_apart(__global const uchar *from, int stride)
{
    if (stride == 1) return *(__global const uchar_lanes *)from;
    uchar_pairs pairs = *(__global const uchar_pairs *)from;
    return __builtin_shufflevector(pairs, pairs, EVENS);
}

// Columns x, x + stride and so on of a row; outside of the picture its edge repeated.
INLINE lanes load_every(__global const float *row, int x, int stride, int width)
{
    if (x >= 0 && x + stride * LANES <= width) return load_apart(row + x, stride);
    lanes some;
    for (int k = 0; k < LANES; k++) some[k] = row[clamp_index(x + k * stride, width)];
    return some;
}

// The same of a row of bytes.
INLINE uchar_lanes load_every_byte(__global const uchar *row, int x, int stride, int width)
{
    if (x >= 0 && x + stride * LANES <= width) return load_bytes_apart(row + x, stride);
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

// The same as sample_weight in evidence_pixel.h, for the colours of the samples.
INLINE lanes sample_weights(const uchar_lanes *own, uchar_lanes a, uchar_lanes b, uchar_lanes c)
{
    uchar_lanes difference = add_up(add_up(apart(own[0], a), apart(own[1], b)), apart(own[2], c));
    uchar_lanes most = UNLIKE, alike = most - (difference < most ? difference : most);
    lanes t = __builtin_convertvector(__builtin_convertvector(alike, int_lanes), lanes) * (1.0f / UNLIKE);
    t = t * t;
    t = t * t;
    return t * t;
}

// What the samples of each lane have summed up.
typedef struct {
    lanes n, g, e, gg, ge, ee;
} Sums;

// Add a sample: of the other picture the four neighbours of its place, share of a pixel to the right of the second.
INLINE void add_sample(
    Sums *sums, lanes t0, lanes t1, lanes t2, lanes t3, lanes share, lanes before, lanes here, lanes after,
    lanes weight)
{
    lanes rest = 1.0f - share, rise = 0.5f * ((t2 - t0) * rest + (t3 - t1) * share);
    lanes g = 0.5f * (rise + 0.5f * (after - before)), e = here - (t1 * rest + t2 * share);
    lanes weighted_g = weight * g, weighted_e = weight * e;
    sums->n += weight;
    sums->g += weighted_g;
    sums->e += weighted_e;
    sums->gg += weighted_g * g;
    sums->ge += weighted_g * e;
    sums->ee += weighted_e * e;
}

// What one block of LANES pixels is computed from.
typedef struct {
    lanes centre, along_x, along_y;
    uchar_lanes colours[3];
} Block;

// Sum up the samples of each lane, wherever they lie.
INLINE Sums add_anywhere(
    __global const float *reference, __global const float *other, __global const uchar *guide, const Block *block,
    int x, int y, int width, int height, int radius, int stride, float way, int weighted)
{
    long pixels = (long)width * height;
    int_lanes own = lane_numbers() * stride + x;
    Sums sums = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
    for (int j = -radius; j <= radius; j++) {
        if (y + j < 0 || y + j >= height) continue;
        long row = (long)(y + j) * width;
        lanes across_row = block->centre + block->along_y * (float)j;
        for (int i = -radius; i <= radius; i++) {
            // Counted from x, so that a part of a picture rounds as the whole of it.
            lanes u = (float)i + way * (across_row + block->along_x * (float)i), whole = floor_lanes(u);
            int_lanes column = __builtin_convertvector(whole, int_lanes) + own, near = own + i;
            int_lanes counts = near >= 1 & near <= width - 2 & column >= 1 & column <= width - 3;
            lanes t0, t1, t2, t3, weight = 1.0f;
            int_lanes from = column < 1 ? 0 : column - 1;
            load_fours(other + row, from > width - 4 ? width - 4 : from, &t0, &t1, &t2, &t3);
            lanes before = load_every(reference + row, x + i - 1, stride, width);
            lanes here = load_every(reference + row, x + i, stride, width);
            lanes after = load_every(reference + row, x + i + 1, stride, width);
            if (weighted)
                weight = sample_weights(
                    block->colours, load_every_byte(guide + row, x + i, stride, width),
                    load_every_byte(guide + pixels + row, x + i, stride, width),
                    load_every_byte(guide + 2 * pixels + row, x + i, stride, width));
            add_sample(&sums, t0, t1, t2, t3, u - whole, before, here, after, counts ? weight : 0.0f);
        }
    }
    return sums;
}

#ifdef __AVX512BW__
#define WIDE 1.0e9f
typedef float raw_lanes __attribute__((vector_size(4 * LANES), aligned(4)));
typedef int raw_places __attribute__((vector_size(4 * LANES)));

// The floats at places 0 to 31, with stride 2 to 47, of vectors that lie side by side.
INLINE lanes look_up(raw_lanes left, raw_lanes middle, raw_lanes right, int_lanes place, int stride)
{
    raw_places at = __builtin_astype(place, raw_places);
    lanes near = __builtin_astype(__builtin_ia32_vpermi2varps512(left, at, middle), lanes);
    if (stride == 1) return near;
    return place < 2 * LANES ? near : __builtin_astype(__builtin_ia32_permvarsf512(right, at), lanes);
}

INLINE float smallest(lanes v)
{
    float8 eight = v.lo < v.hi ? v.lo : v.hi;
    float4 four = eight.lo < eight.hi ? eight.lo : eight.hi;
    float2 two = four.lo < four.hi ? four.lo : four.hi;
    return two.x < two.y ? two.x : two.y;
}

// How far to the right of x the first of all neighbours lies, where those of all samples lie in both pictures and, of
// a row, in as many vectors as look_up takes; else INT_MIN.
INLINE int start_of_all(
    const Block *block, int_lanes given, int x, int y, int width, int height, int radius, int stride, float way)
{
    float reach = (float)radius;
    lanes own = __builtin_convertvector(lane_numbers() * stride, lanes) + way * block->centre;
    lanes spread = (magnitude(block->along_x) + magnitude(block->along_y)) * reach + 0.5f; // with room for rounding
    float least = smallest(given ? own - spread : WIDE), most = -smallest(given ? -own - spread : WIDE);
    if (!(least > -WIDE && most < WIDE)) return INT_MIN;
    int start = floor_to_int(least) - 1, holds = (stride + 1) * LANES;
    int bottom = y + radius < height ? y + radius : height - 1;
    int together = most + 2.0f < (float)(start + holds);
    int inside = x - radius + start >= 0 && (float)(x + radius + 2) + most < (float)(width - 1);
    inside = inside && x - radius >= 1 && x + radius + 1 + stride * LANES <= width;
    int readable = (long)bottom * width + x + radius + start + holds <= (long)width * height;
    return together && inside && readable ? start : INT_MIN;
}

// The same as add_anywhere where start_of_all says where the samples lie. On a smooth surface that is the rule.
INLINE Sums add_together(
    __global const float *reference, __global const float *other, __global const uchar *guide, const Block *block,
    int x, int y, int width, int height, int radius, int stride, float way, int weighted, int start)
{
    long pixels = (long)width * height;
    int_lanes own = lane_numbers() * stride - (start + 1);
    Sums sums = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
    for (int j = -radius; j <= radius; j++) {
        if (y + j < 0 || y + j >= height) continue;
        long row = (long)(y + j) * width + x;
        lanes across_row = block->centre + block->along_y * (float)j;
        __global const float *ours = reference + row;
        lanes here = load_apart(ours - radius - 1, stride), after = load_apart(ours - radius, stride);
        for (int i = -radius; i <= radius; i++) {
            lanes u = (float)i + way * (across_row + block->along_x * (float)i), whole = floor_lanes(u), weight = 1.0f;
            int_lanes place = __builtin_convertvector(whole, int_lanes) + (own - i);
            __global const float *from = other + row + i + start;
            raw_lanes left = *(__global const raw_lanes *)from, middle = *(__global const raw_lanes *)(from + LANES);
            raw_lanes right = middle;
            if (stride == 2) right = *(__global const raw_lanes *)(from + 2 * LANES);
            lanes before = here;
            here = after;
            after = load_apart(ours + i + 1, stride);
            __global const uchar *theirs = guide + row + i;
            if (weighted)
                weight = sample_weights(
                    block->colours, load_bytes_apart(theirs, stride), load_bytes_apart(theirs + pixels, stride),
                    load_bytes_apart(theirs + 2 * pixels, stride));
            add_sample(
                &sums, look_up(left, middle, right, place, stride), look_up(left, middle, right, place + 1, stride),
                look_up(left, middle, right, place + 2, stride), look_up(left, middle, right, place + 3, stride),
                u - whole, before, here, after, weight);
        }
    }
    return sums;
}
#endif

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
    int_lanes given = value == value;
    Block block;
    block.centre = given ? value : 0.0f;
    block.along_x = load_every(along_x + place, x, stride, width);
    block.along_y = load_every(along_y + place, x, stride, width);
    for (int c = 0; c < 3 && weighted; c++)
        block.colours[c] = load_every_byte(guide + c * pixels + place, x, stride, width);
    Sums sums;
#ifdef __AVX512BW__
    int start = start_of_all(&block, given, x, y, width, height, radius, stride, way);
    if (start != INT_MIN)
        sums = add_together(
            reference, other, guide, &block, x, y, width, height, radius, stride, way, weighted, start);
    else
#endif
        sums = add_anywhere(reference, other, guide, &block, x, y, width, height, radius, stride, way, weighted);
    lanes n = sums.n;
    int_lanes tells = given & (n >= EVIDENCE_ENOUGH);
    lanes gg = sums.gg - sums.g * sums.g / n, ge = sums.ge - sums.g * sums.e / n, ee = sums.ee - sums.e * sums.e / n;
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
