// Winner takes all over a volume of scores, for both views: the form for CPUs.
//
// A work-item owns a band of rows and reads the volume once, as it lies in memory. Every vector holds the keys of LANES
// disparities of one pixel, which raise those of as many neighbours in the other view's row.
#include "lanes.h"
#include "peaks.h"
#define INLINE inline __attribute__((always_inline))

INLINE int_lanes larger(int_lanes a, int_lanes b) { return a > b ? a : b; }

INLINE int largest(int_lanes v)
{
#ifdef __AVX2__
#if LANES == 16
    int8 eight = v.lo > v.hi ? v.lo : v.hi;
#else
    int8 eight = v;
#endif
    int4 four = eight.lo > eight.hi ? eight.lo : eight.hi;
    int2 two = four.lo > four.hi ? four.lo : four.hi;
    return two.x > two.y ? two.x : two.y;
#else
    int result = v[0];
    for (int k = 1; k < LANES; k++) result = v[k] > result ? v[k] : result;
    return result;
#endif
}

INLINE int_lanes reversed(int_lanes v)
{
#if LANES == 16
    return __builtin_shufflevector(v, v, 15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0);
#else
    return __builtin_shufflevector(v, v, 7, 6, 5, 4, 3, 2, 1, 0);
#endif
}

// Scores of disparities i and on, of which there may be less than LANES; beyond them anything. room tells how many
// scores there are in memory.
INLINE lanes load_scores(__global const float *scores, long room)
{
    if (room >= LANES) return *(__global const lanes *)scores;
    lanes result = 0.0f;
    for (int k = 0; k < room; k++) result[k] = scores[k];
    return result;
}

// Raise the keys of the other view's row from column u on, as far as it goes.
INLINE void raise(__global int *row, int u, int width, int_lanes keys)
{
    if (u >= 0 && u + LANES <= width) {
        __global int_lanes *held = (__global int_lanes *)(row + u);
        *held = larger(*held, keys);
    } else if (u > -LANES && u < width) {
        for (int k = 0; k < LANES; k++)
            if (u + k >= 0 && u + k < width && keys[k] > row[u + k]) row[u + k] = keys[k];
    }
}

// What wta.cl computes; other_out may come in as anything.
__kernel void wta(
    // In:
    __global const float *volume,
    __global const uchar *validity,
    int width,
    int height,
    int smallest,
    int disparities,
    int direction,
    int subpixel,
    // Out:
    __global float *disparity_out,
    __global float *score_out,
    __global float *ratio_out,
    __global uchar *validity_out,
    __global int *other_out)
{
    int2 rows = band_of_rows(height);
    int bits = index_bits(disparities), last_index = (1 << bits) - 1;
    float scale = score_scale(bits);
    for (int y = rows.x; y < rows.y; y++) {
        __global int *row = other_out + (long)y * width;
        for (int u = 0; u < width; u++) row[u] = 0;
        for (int x = 0; x < width; x++) {
            long pixel = (long)y * width + x, room = ((long)height * width - pixel) * disparities;
            __global const float *scores = volume + pixel * disparities;
            int zero = x + direction * smallest; // the other view's pixel at the first disparity
            // Of every LANES-th disparity the two highest keys: neighbours are in different lanes, so that of the
            // winner and its neighbours none hides the runner-up.
            int_lanes high = 0, second = 0;
            for (int i = 0; i < disparities; i += LANES) {
                int_lanes level = __builtin_convertvector(load_scores(scores + i, room - i) * scale, int_lanes);
                int_lanes key = (level << bits) | (last_index - i - lane_numbers());
                key = level > 0 ? key : 0;
                if (i + LANES > disparities) key = lane_numbers() + i < disparities ? key : 0;
                if (direction > 0) raise(row, zero + i, width, key);
                else raise(row, zero - i - (LANES - 1), width, reversed(key));
                second = larger(second, key < high ? key : high);
                high = larger(high, key);
            }
            int winner = largest(high), best = winner >> bits, at = key_index(winner, bits);
            score_out[pixel] = (float)best / scale;
            if (winner == 0) {
                disparity_out[pixel] = NAN;
                ratio_out[pixel] = 0.0f;
                validity_out[pixel] = validity[pixel] ? validity[pixel] : OUT_OF_RANGE;
                continue;
            }
            int_lanes away = (high & last_index) - (winner & last_index);
            int runner = largest((away >= -1 & away <= 1) ? second : high) >> bits;
            int before = at > 0 ? score_level(scores[at - 1], bits) : 0;
            int after = at < disparities - 1 ? score_level(scores[at + 1], bits) : 0;
            disparity_out[pixel] = peak_disparity(at, best, before, after, smallest, subpixel);
            ratio_out[pixel] = (float)runner / (float)best;
            validity_out[pixel] = 0;
        }
    }
}
