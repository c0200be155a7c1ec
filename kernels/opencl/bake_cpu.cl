// Resample a picture into a texture atlas: the form for CPUs.
//
// A work-item owns a band of rows of the atlas. The shares of LANES texels are found at a time; then one texel after the
// other takes its 4 x 4 pixels, a row of which, with all their colours, is one vector.
#include "lanes.h"
#include "light.h"
#include "colour.h"
#include "cubic.h"
#include "bake_texel.h"
typedef ushort row_of_four __attribute__((ext_vector_type(16), aligned(2)));
typedef float floats_of_four __attribute__((ext_vector_type(16)));

// Shares of LANES samples, as cubic_shares has them.
inline void shares_of(lanes t, float *shares)
{
    *(lanes *)shares = ((-0.5f * t + 1.0f) * t - 0.5f) * t;
    *(lanes *)(shares + LANES) = (1.5f * t - 2.5f) * t * t + 1.0f;
    *(lanes *)(shares + 2 * LANES) = ((-1.5f * t + 2.0f) * t + 0.5f) * t;
    *(lanes *)(shares + 3 * LANES) = (0.5f * t - 0.5f) * t * t;
}

inline floats_of_four pixels_at(__global const ushort *light, int index)
{
    return __builtin_convertvector(*(__global const row_of_four *)(light + (long)index * 4), floats_of_four);
}

// The sample whose first pixel of 4 x 4 is at `index`; the same order of operations as in cubic.h.
inline colour sample_inside(__global const ushort *light, int index, int width, const float *across, const float *down)
{
    floats_of_four sum = pixels_at(light, index) * down[0] + pixels_at(light, index + width) * down[LANES] +
        pixels_at(light, index + 2 * width) * down[2 * LANES] + pixels_at(light, index + 3 * width) * down[3 * LANES];
    float columns[16] __attribute__((aligned(64)));
    *(floats_of_four *)columns = sum;
    const colour *column = (const colour *)columns;
    return column[0] * across[0] + column[1] * across[LANES] + column[2] * across[2 * LANES] +
        column[3] * across[3 * LANES];
}

// What bake.cl computes.
__kernel void bake(
    // In:
    __global const ushort *light,
    __global const float *places,
    int width,
    int height,
    float cell,
    float bias,
    float gain,
    int texture_width,
    int texture_height,
    // Out:
    __global ushort *texture_out)
{
    int2 rows = band_of_rows(texture_height);
    float share = 1.0f / cell;
    for (int y = rows.x; y < rows.y; y++) {
        __global const float *us = places + (long)y * texture_width, *vs = us + (long)texture_height * texture_width;
        for (int x = 0; x < texture_width; x += LANES) {
            if (x + LANES > texture_width) {
                for (; x < texture_width; x++)
                    if (us[x] == us[x])
                        bake_texel(
                            light, width, height, us[x], vs[x], share, bias, gain, y * texture_width + x, texture_out);
                break;
            }
            lanes u = *(__global const lanes *)(us + x), v = *(__global const lanes *)(vs + x);
            int_lanes there = u == u;
            if (!any_lane(there)) continue;
            u = there ? (u + 0.5f) * share - 0.5f : 0.0f;
            v = there ? (v + 0.5f) * share - 0.5f : 0.0f;
            lanes left = floor_lanes(u), top = floor_lanes(v);
            float across[4 * LANES] ALIGNED, down[4 * LANES] ALIGNED;
            shares_of(u - left, across);
            shares_of(v - top, down);
            int_lanes column = __builtin_convertvector(left, int_lanes) - 1;
            int_lanes row = __builtin_convertvector(top, int_lanes) - 1;
            int_lanes inside = column >= 0 & column + 3 < width & row >= 0 & row + 3 < height;
            int first[LANES] ALIGNED;
            *(int_lanes *)first = there ? (inside ? row * width + column : -1) : -2;
            for (int k = 0; k < LANES; k++) {
                if (first[k] == -2) continue;
                int texel = y * texture_width + x + k;
                if (first[k] < 0) {
                    bake_texel(light, width, height, us[x + k], vs[x + k], share, bias, gain, texel, texture_out);
                    continue;
                }
                colour value = sample_inside(light, first[k], width, across + k, down + k);
                __global packed_colour *to = (__global packed_colour *)texture_out + texel;
                colour sum = __builtin_convertvector(*to, colour) + (value - bias) * gain;
                sum.w = 65535.0f;
                sum = sum > 0.0f ? sum : 0.0f;
                sum = (sum < 65535.0f ? sum : 65535.0f) + 0.5f;
                *to = __builtin_convertvector(sum, packed_colour);
            }
        }
    }
}
