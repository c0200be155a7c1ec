// Resample a picture into a texture atlas: the form for CPUs.
//
// A work-item owns a band of rows of the atlas and takes LANES texels at a time, each with its own triangle.
#include "lanes.h"
#include "sampling.h"
#include "weights.h"
#include "bake_texel.h"
#include "colours.h"
#include "quarters.h"
typedef uint uint_lanes __attribute__((ext_vector_type(LANES)));
typedef uchar padded_lanes __attribute__((ext_vector_type(4 * LANES)));
typedef uchar colour_lanes __attribute__((ext_vector_type(3 * LANES), aligned(1)));

// Where LANES samples lie: indices of their four neighbours, and their shares.
typedef struct {
    int_lanes p00, p01, p10, p11;
    lanes across, down;
} Places;

inline int_lanes clamp_lanes(int_lanes index, int size)
{
    index = index < 0 ? 0 : index;
    return index < size ? index : size - 1;
}

// The colours of pixels by their index, which has no memory behind its last pixel.
inline four_lanes load_colours(__global const PIXEL *picture, int_lanes index, int pixels)
{
#define COLOUR(i) *(__global const LooseFour *)(picture + i)
    int_lanes at = index * 3, last = pixels * 3 - 4;
    int_lanes safe = at < last ? at : last;
    return (four_lanes)EACH(COLOUR, safe) >> __builtin_convertvector((at - safe) * BITS, four_lanes);
}

inline four_lanes load_greys(__global const PIXEL *picture, int_lanes index)
{
#define GREY(i) (Four)picture[i]
    return (four_lanes)EACH(GREY, index);
}

// Levels 0 to 255 of one channel; the same order of operations as in sampling.h.
inline uint_lanes blend(
    four_lanes p00, four_lanes p01, four_lanes p10, four_lanes p11, int shift, Places at, float scale, int_lanes owned)
{
    lanes upper = levels(p00, shift) * (1.0f - at.across) + levels(p01, shift) * at.across;
    lanes lower = levels(p10, shift) * (1.0f - at.across) + levels(p11, shift) * at.across;
    lanes value = scale * (upper * (1.0f - at.down) + lower * at.down);
    value = owned ? value : 0.0f;
    return __builtin_convertvector((value < 255.0f ? value : 255.0f) + 0.5f, uint_lanes);
}

// Where in the picture the centres of LANES texels lie; the same order of operations as in weights.h.
inline Places find_places(
    __global const float *corners, int_lanes face, int_lanes owned, int x, int y, int width, int height)
{
    lanes ax, ay, au, av, az, bx, by, bu, bv, bz, cx, cy, cu, cv, cz;
    load_fours(corners, face * 15, &ax, &ay, &au, &av);
    load_fours(corners, face * 15 + 4, &az, &bx, &by, &bu);
    load_fours(corners, face * 15 + 8, &bv, &bz, &cx, &cy);
    load_fours(corners, face * 15 + 11, &cy, &cu, &cv, &cz);
    lanes px = __builtin_convertvector(lane_numbers() + x, lanes) + 0.5f;
    float py = (float)y + 0.5f;
    lanes area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
    lanes a = ((bx - px) * (cy - py) - (by - py) * (cx - px)) / area;
    lanes b = ((cx - px) * (ay - py) - (cy - py) * (ax - px)) / area;
    lanes c = 1.0f - a - b;
    a = area == 0.0f ? -1.0f : a;
    b = area == 0.0f ? -1.0f : b;
    c = area == 0.0f ? -1.0f : c;
    lanes z = a * az + b * bz + c * cz;
    lanes u = (a * au + b * bu + c * cu) / z, v = (a * av + b * bv + c * cv) / z;
    u = owned ? u : 0.0f;
    v = owned ? v : 0.0f;
    lanes column = floor_lanes(u), row = floor_lanes(v);
    int_lanes left = __builtin_convertvector(column, int_lanes), top = __builtin_convertvector(row, int_lanes);
    int_lanes right = clamp_lanes(left + 1, width), bottom = clamp_lanes(top + 1, height) * width;
    left = clamp_lanes(left, width);
    top = clamp_lanes(top, height) * width;
    Places at = {top + left, top + right, bottom + left, bottom + right, u - column, v - row};
    return at;
}

// What bake.cl computes.
__kernel void bake(
    // In:
    __global const PIXEL *picture,
    __global const float *corners,
    __global const int *owner,
    int width,
    int height,
    int channels,
    float scale,
    int texture_width,
    int texture_height,
    // Out:
    __global uchar *texture_out,
    __global uchar *covered_out)
{
    int2 rows = band_of_rows(texture_height);
    int few = texture_width < LANES || width * height < 2;
    for (int y = rows.x; y < rows.y; y++) {
        for (int start = 0; start < texture_width; start += few ? 1 : LANES) {
            if (few) {
                bake_texel(
                    picture, corners, owner, width, height, channels, scale, texture_width, start, y, texture_out,
                    covered_out);
                continue;
            }
            // The last lanes of a row overlap with those before.
            int x = start + LANES <= texture_width ? start : texture_width - LANES;
            long texel = (long)y * texture_width + x;
            int_lanes number = *(__global const int_lanes *)(owner + texel), owned = number > 0;
            uint_lanes colour = 0;
            if (any_lane(owned)) {
                Places at = find_places(corners, (owned ? number : 1) - 1, owned, x, y, width, height);
                int grey = channels == 1;
                four_lanes p00 = grey ? load_greys(picture, at.p00) : load_colours(picture, at.p00, width * height);
                four_lanes p01 = grey ? load_greys(picture, at.p01) : load_colours(picture, at.p01, width * height);
                four_lanes p10 = grey ? load_greys(picture, at.p10) : load_colours(picture, at.p10, width * height);
                four_lanes p11 = grey ? load_greys(picture, at.p11) : load_colours(picture, at.p11, width * height);
                colour = blend(p00, p01, p10, p11, 0, at, scale, owned);
                uint_lanes green = grey ? colour : blend(p00, p01, p10, p11, BITS, at, scale, owned);
                uint_lanes blue = grey ? colour : blend(p00, p01, p10, p11, 2 * BITS, at, scale, owned);
                colour = colour | green << 8 | blue << 16;
            }
            padded_lanes padded = __builtin_astype(colour, padded_lanes);
            *(__global colour_lanes *)(texture_out + texel * 3) =
                __builtin_shufflevector(padded, padded, WITHOUT_FOURTHS);
            lanes one = owned ? 1.0f : 0.0f;
            *(__global uchar_lanes *)(covered_out + texel) = __builtin_convertvector(one, uchar_lanes);
        }
    }
}
