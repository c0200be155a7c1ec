// What a textured mesh, seen from the camera of its picture, lacks of that picture: the form for CPUs.
//
// A work-item owns a band of rows of the picture. The shares of LANES pixels are found at a time; then one pixel after the
// other takes its 2 x 2 texels, two of which, with all their colours, are one vector.
#include "lanes.h"
#include "light.h"
#include "colour.h"
#include "residual_pixel.h"
typedef ushort row_of_two __attribute__((ext_vector_type(8), aligned(2)));
typedef float floats_of_two __attribute__((ext_vector_type(8)));

// What residual.cl computes.
__kernel void residual(
    // In:
    __global const ushort *light,
    __global const ushort *texture,
    __global const float *places,
    int texture_width,
    int texture_height,
    int width,
    int height,
    // Out:
    __global ushort *residual_out)
{
    int2 rows = band_of_rows(height);
    for (int y = rows.x; y < rows.y; y++) {
        __global const float *ss = places + (long)y * width, *ts = ss + (long)height * width;
        for (int x = 0; x < width; x += LANES) {
            lanes s = NAN, t = NAN;
            if (x + LANES <= width) {
                s = *(__global const lanes *)(ss + x);
                t = *(__global const lanes *)(ts + x);
            } else {
                for (int k = 0; x + k < width; k++) {
                    s[k] = ss[x + k];
                    t[k] = ts[x + k];
                }
            }
            int_lanes there = s == s;
            s = there ? s : 0.0f;
            t = there ? t : 0.0f;
            lanes left = floor_lanes(s), top = floor_lanes(t);
            int_lanes column = __builtin_convertvector(left, int_lanes), row = __builtin_convertvector(top, int_lanes);
            int_lanes inside = column >= 0 & column + 1 < texture_width & row >= 0 & row + 1 < texture_height;
            int first[LANES] ALIGNED;
            float across[LANES] ALIGNED, down[LANES] ALIGNED;
            *(int_lanes *)first = there ? (inside ? row * texture_width + column : -1) : -2;
            *(lanes *)across = s - left;
            *(lanes *)down = t - top;
            for (int k = 0; k < LANES && x + k < width; k++) {
                int pixel = y * width + x + k;
                __global packed_colour *to = (__global packed_colour *)residual_out + pixel;
                if (first[k] == -2) {
                    *to = (packed_colour)(32768);
                    continue;
                }
                if (first[k] < 0) {
                    residual_pixel(light, texture, texture_width, texture_height, pixel, ss[x + k], ts[x + k], residual_out);
                    continue;
                }
                __global const ushort *from = texture + (long)first[k] * 4;
                row_of_two upper = *(__global const row_of_two *)from;
                row_of_two lower = *(__global const row_of_two *)(from + texture_width * 4);
                if (!(upper[3] && upper[7] && lower[3] && lower[7])) {
                    *to = (packed_colour)(32768);
                    continue;
                }
                // The same order of operations as in residual_pixel.h.
                float sides[8] __attribute__((aligned(32)));
                *(floats_of_two *)sides = __builtin_convertvector(upper, floats_of_two) * (1.0f - down[k]) +
                    __builtin_convertvector(lower, floats_of_two) * down[k];
                const colour *side = (const colour *)sides;
                colour shown = side[0] * (1.0f - across[k]) + side[1] * across[k];
                colour own = __builtin_convertvector(*((__global const packed_colour *)light + pixel), colour);
                colour sum = (own - shown) * 0.5f + 32768.0f;
                sum = sum > 0.0f ? sum : 0.0f;
                sum = (sum < 65535.0f ? sum : 65535.0f) + 0.5f;
                *to = __builtin_convertvector(sum, packed_colour);
            }
        }
    }
}
