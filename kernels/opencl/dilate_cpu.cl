// Grow the baked charts by one texel: the form for CPUs.
//
// A work-item owns a band of rows. Most texels lie inside of a chart, and are copied, or far from one, and stay black:
// LANES of either are done at once. So are the rest, whose colours lie in memory as three times LANES bytes.
#include "lanes.h"
#include "dilate_texel.h"
typedef uchar some __attribute__((ext_vector_type(LANES)));
typedef short sums __attribute__((ext_vector_type(LANES)));

// Of LANES values one for each byte of part 0, 1 or 2 of as many colours.
#define THIRD(part, k) (part * LANES + k) / 3
#if LANES == 16
#define SPREAD(v, part) __builtin_shufflevector(v, v, THIRD(part, 0), THIRD(part, 1), THIRD(part, 2), THIRD(part, 3), \
    THIRD(part, 4), THIRD(part, 5), THIRD(part, 6), THIRD(part, 7), THIRD(part, 8), THIRD(part, 9), THIRD(part, 10), \
    THIRD(part, 11), THIRD(part, 12), THIRD(part, 13), THIRD(part, 14), THIRD(part, 15))
#else
#define SPREAD(v, part) __builtin_shufflevector(v, v, THIRD(part, 0), THIRD(part, 1), THIRD(part, 2), THIRD(part, 3), \
    THIRD(part, 4), THIRD(part, 5), THIRD(part, 6), THIRD(part, 7))
#endif

inline some load(__global const uchar *from) { return *(__global const uchar_lanes *)from; }

inline void store(__global uchar *to, some v) { *(__global uchar_lanes *)to = v; }

// Whether all are 0.
inline int none(some v)
{
#if LANES == 16
    ulong2 halves = __builtin_astype(v, ulong2);
    return (halves.x | halves.y) == 0;
#else
    return __builtin_astype(v, ulong) == 0;
#endif
}

// LANES texels that have eight neighbours each.
inline void dilate_texels(
    __global const uchar *texture, __global const uchar *covered, int width, __global uchar *texture_out,
    __global uchar *covered_out)
{
    some own = load(covered), above = 0, here = 0, below = 0;
    for (int i = -1; i <= 1; i++) {
        above |= load(covered - width + i);
        here |= load(covered + i);
        below |= load(covered + width + i);
    }
    some coloured = own != (uchar)0 ? (uchar)255 : (uchar)0;
    if (none(~coloured) || none(above | here | below)) {
        for (int part = 0; part < 3; part++)
            store(texture_out + part * LANES, none(own) ? (some)0 : load(texture + part * LANES));
        store(covered_out, coloured & (uchar)1);
        return;
    }
    some count = 0;
    sums first = 0, second = 0, third = 0;
    for (int j = -1; j <= 1; j++) {
        for (int i = -1; i <= 1; i++) {
            int near = j * width + i;
            some has = load(covered + near) != (uchar)0 ? (uchar)255 : (uchar)0;
            __global const uchar *colour = texture + 3 * near;
            count += has & (uchar)1;
            first += __builtin_convertvector(load(colour) & SPREAD(has, 0), sums);
            second += __builtin_convertvector(load(colour + LANES) & SPREAD(has, 1), sums);
            third += __builtin_convertvector(load(colour + 2 * LANES) & SPREAD(has, 2), sums);
        }
    }
    lanes many = __builtin_convertvector(count > (uchar)1 ? count : (uchar)1, lanes);
#define MEAN(sum, part) \
    __builtin_convertvector(__builtin_convertvector(sum, lanes) / SPREAD(many, part) + 0.5f, some)
    store(texture_out, SPREAD(coloured, 0) ? load(texture) : MEAN(first, 0));
    store(texture_out + LANES, SPREAD(coloured, 1) ? load(texture + LANES) : MEAN(second, 1));
    store(texture_out + 2 * LANES, SPREAD(coloured, 2) ? load(texture + 2 * LANES) : MEAN(third, 2));
    store(covered_out, count > (uchar)1 ? (some)(uchar)1 : count);
}

// What dilate.cl computes.
__kernel void dilate(
    // In:
    __global const uchar *texture,
    __global const uchar *covered,
    int width,
    int height,
    // Out:
    __global uchar *texture_out,
    __global uchar *covered_out)
{
    int2 rows = band_of_rows(height);
    for (int y = rows.x; y < rows.y; y++) {
        for (int x = 0; x < width;) {
            long texel = (long)y * width + x;
            if (x > 0 && x + LANES < width && y > 0 && y < height - 1) {
                dilate_texels(
                    texture + 3 * texel, covered + texel, width, texture_out + 3 * texel, covered_out + texel);
                x += LANES;
            } else {
                dilate_texel(texture, covered, width, height, x, y, texture_out, covered_out);
                x++;
            }
        }
    }
}
