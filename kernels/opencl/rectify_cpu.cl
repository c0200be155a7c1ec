// Undistort and rectify in one resampling of the raw picture: the form for CPUs.
//
// A work-item owns a strip of rows and takes it in blocks of SPAN pixels of a row: first where they all lie in the
// raw picture, then what is there. Done pixel by pixel, a processor would mostly wait for one long chain of results;
// apart, it has many short ones at hand. Neighbours in a row of the raw picture are loaded together. Terms of the lens
// model whose coefficients are all 0 are left out, which changes no bit.
#include "lanes.h"
#include "sampling.h"
#include "rectify_pixel.h"
#include "colours.h"

// A whole number that holds two grey pixels.
#define TWO_uchar ushort
#define TWO_ushort uint
typedef FOR_PIXEL(TWO_, PIXEL) Two;
typedef Two LooseTwo __attribute__((aligned(1)));
typedef Two two_lanes __attribute__((ext_vector_type(LANES)));
typedef PIXEL grey_lanes __attribute__((ext_vector_type(LANES), aligned(1)));
typedef PIXEL colour_lanes __attribute__((ext_vector_type(3 * LANES), aligned(1)));
typedef PIXEL padded_lanes __attribute__((ext_vector_type(4 * LANES)));
#define SPAN 128

// For each pixel of a block: index of the upper left one of its four neighbours, how far it lies from it, and 1 where
// it lies inside the raw picture, else 0.
typedef struct {
    int_lanes corner[SPAN / LANES];
    lanes across[SPAN / LANES], down[SPAN / LANES], inside[SPAN / LANES];
} __attribute__((aligned(64))) Places;

// The first of LANES pixels of a row; the last ones of a row overlap with those before.
inline int lanes_start(int x, int width) { return x + LANES <= width ? x : width - LANES; }

// Bilinear values, rounded; 0 where not inside. The same order of operations as in sampling.h.
inline int_lanes blend(
    lanes p00, lanes p01, lanes p10, lanes p11, lanes across, lanes down, lanes inside)
{
    lanes upper = p00 * (1.0f - across) + p01 * across;
    lanes lower = p10 * (1.0f - across) + p11 * across;
    lanes value = upper * (1.0f - down) + lower * down;
    return __builtin_convertvector(inside > 0.0f ? value + 0.5f : 0.0f, int_lanes);
}

inline void sample_grey(
    __global const PIXEL *picture, int stride, const int *corner, lanes across, lanes down, lanes inside,
    __global PIXEL *grey_out)
{
#define UPPER(i) *(__global const LooseTwo *)(picture + i)
#define LOWER(i) *(__global const LooseTwo *)(picture + stride + i)
    int_lanes upper = __builtin_convertvector((two_lanes)EACH(UPPER, corner), int_lanes);
    int_lanes lower = __builtin_convertvector((two_lanes)EACH(LOWER, corner), int_lanes);
    lanes p00 = __builtin_convertvector(upper & LARGEST, lanes);
    lanes p01 = __builtin_convertvector(upper >> BITS & LARGEST, lanes);
    lanes p10 = __builtin_convertvector(lower & LARGEST, lanes);
    lanes p11 = __builtin_convertvector(lower >> BITS & LARGEST, lanes);
    int_lanes value = blend(p00, p01, p10, p11, across, down, inside);
    *(__global grey_lanes *)grey_out = __builtin_convertvector(value, grey_lanes);
}

inline void sample_colour(
    __global const PIXEL *picture, int stride, const int *corner, lanes across, lanes down, lanes inside,
    __global PIXEL *colour_out)
{
    // Right neighbours are loaded with the channel before them: one after the last pixel would be out of bounds.
#define P00(i) *(__global const LooseFour *)(picture + i)
#define P01(i) *(__global const LooseFour *)(picture + i + 2)
#define P10(i) *(__global const LooseFour *)(picture + stride + i)
#define P11(i) *(__global const LooseFour *)(picture + stride + i + 2)
    four_lanes p00 = (four_lanes)EACH(P00, corner), p01 = (four_lanes)EACH(P01, corner);
    four_lanes p10 = (four_lanes)EACH(P10, corner), p11 = (four_lanes)EACH(P11, corner);
#define CHANNEL(shift) \
    (__builtin_convertvector( \
         blend(levels(p00, shift), levels(p01, shift + BITS), levels(p10, shift), levels(p11, shift + BITS), across, \
               down, inside), \
         four_lanes) \
     << (shift))
    four_lanes value = CHANNEL(0) | CHANNEL(BITS) | CHANNEL(2 * BITS);
    padded_lanes padded = __builtin_astype(value, padded_lanes);
    *(__global colour_lanes *)colour_out = __builtin_shufflevector(padded, padded, WITHOUT_FOURTHS);
}

// What rectify.cl computes.
__kernel void rectify(
    // In:
    __global const PIXEL *picture,
    __global const float *lens,
    __global const float *ray,
    int source_width,
    int source_height,
    int channels,
    int width,
    int height,
    // Out:
    __global PIXEL *rectified_out,
    __global uchar *valid_out)
{
    int2 rows = band_of_rows(height);
    if (width < LANES || source_width < 2 || source_height < 2) {
        for (int y = rows.x; y < rows.y; y++)
            for (int x = 0; x < width; x++)
                rectify_pixel(
                    picture, lens, ray, source_width, source_height, channels, x, y, width, rectified_out, valid_out);
        return;
    }
    int rational = lens[9] != 0.0f || lens[10] != 0.0f || lens[11] != 0.0f;
    int tangential = lens[6] != 0.0f || lens[7] != 0.0f;
    int prism = lens[12] != 0.0f || lens[13] != 0.0f || lens[14] != 0.0f || lens[15] != 0.0f;
    int stride = source_width * channels;
    float far_column = (float)(source_width - 1), far_row = (float)(source_height - 1);
    Places places;
    for (int y = rows.x; y < rows.y; y++) {
        float row = (float)y;
        float row_a = ray[1] * row, row_b = ray[4] * row, row_depth = ray[7] * row;
        __global uchar *row_valid = valid_out + (long)y * width;
        __global PIXEL *row_out = rectified_out + (long)y * width * channels;
        for (int begin = 0; begin < width; begin += SPAN) {
            int groups = ((begin + SPAN < width ? SPAN : width - begin) + LANES - 1) / LANES;
            for (int g = 0; g < groups; g++) {
                int x = lanes_start(begin + g * LANES, width);
                lanes column = __builtin_convertvector(lane_numbers() + x, lanes);
                lanes depth = ray[6] * column + row_depth + ray[8];
                lanes a = (ray[0] * column + row_a + ray[2]) / depth;
                lanes b = (ray[3] * column + row_b + ray[5]) / depth;
                lanes r2 = a * a + b * b;
                lanes radial = 1.0f + r2 * (lens[4] + r2 * (lens[5] + r2 * lens[8]));
                if (rational) radial = radial / (1.0f + r2 * (lens[9] + r2 * (lens[10] + r2 * lens[11])));
                lanes bent_a = a * radial, bent_b = b * radial;
                if (tangential) {
                    bent_a = bent_a + 2.0f * lens[6] * a * b + lens[7] * (r2 + 2.0f * a * a);
                    bent_b = bent_b + lens[6] * (r2 + 2.0f * b * b) + 2.0f * lens[7] * a * b;
                }
                if (prism) {
                    bent_a += r2 * (lens[12] + r2 * lens[13]);
                    bent_b += r2 * (lens[14] + r2 * lens[15]);
                }
                lanes u = lens[0] * bent_a + lens[2], v = lens[1] * bent_b + lens[3];
                int_lanes inside = depth > 0.0f & u >= 0.0f & v >= 0.0f & u <= far_column & v <= far_row;
                // What lies outside reads some pixel that is there.
                u = inside ? u : 0.0f;
                v = inside ? v : 0.0f;
                // On the last column or row the neighbours are the ones before, with all the weight on the far ones.
                int_lanes left = __builtin_convertvector(u, int_lanes), top = __builtin_convertvector(v, int_lanes);
                left = left < source_width - 2 ? left : source_width - 2;
                top = top < source_height - 2 ? top : source_height - 2;
                places.inside[g] = inside ? 1.0f : 0.0f;
                places.corner[g] = top * stride + left * channels;
                places.across[g] = u - __builtin_convertvector(left, lanes);
                places.down[g] = v - __builtin_convertvector(top, lanes);
            }
            for (int g = 0; g < groups; g++) {
                int x = lanes_start(begin + g * LANES, width);
                const int *corner = (const int *)&places.corner[g];
                lanes across = places.across[g], down = places.down[g], inside = places.inside[g];
                *(__global uchar_lanes *)(row_valid + x) = __builtin_convertvector(inside, uchar_lanes);
                if (channels == 1)
                    sample_grey(picture, stride, corner, across, down, inside, row_out + x);
                else
                    sample_colour(picture, stride, corner, across, down, inside, row_out + x * 3);
            }
        }
    }
}
