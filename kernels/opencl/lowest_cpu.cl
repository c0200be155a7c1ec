// Winner takes all over sums of paths: the form for CPUs.
//
// A work-item owns a band of rows. The sums of a pixel are looked through three times, for the lowest one, its place and
// the lowest one elsewhere, since after the first time they lie in the cache.
#include "lanes.h"
#include "shorts.h"
#include "lowest.h"
#define NONE 65535
#define INLINE inline __attribute__((always_inline))

// Sums of disparities i and on, of which there may be less than SHORTS; beyond them NONE. room tells how many there are
// in memory.
INLINE ushorts load_sums(__global const ushort *sums, int i, int disparities, long room)
{
    if (i + SHORTS <= disparities) return *(__global const ushorts *)(sums + i);
    ushorts result = NONE;
    if (i + SHORTS <= room) {
        result = *(__global const ushorts *)(sums + i);
    } else {
        for (int k = 0; i + k < disparities; k++) result[k] = sums[i + k];
    }
    return NUMBERS(ushorts) < (ushort)(disparities - i) ? result : (ushorts)NONE;
}

// What lowest.cl computes.
__kernel void lowest(
    // In:
    __global const ushort *sums,
    __global const uchar *validity,
    int width,
    int height,
    int smallest,
    int disparities,
    int subpixel,
    // Out:
    __global float *disparity_out,
    __global float *lowest_out,
    __global float *ratio_out,
    __global uchar *validity_out)
{
    int2 rows = band_of_rows(height);
    long end = (long)width * height;
    for (long pixel = (long)rows.x * width; pixel < (long)rows.y * width; pixel++) {
        __global const ushort *own = sums + pixel * disparities;
        long room = (end - pixel) * disparities;
        ushorts low = NONE;
        for (int i = 0; i < disparities; i += SHORTS) {
            ushorts here = load_sums(own, i, disparities, room);
            low = here < low ? here : low;
        }
        int best = smallest_of(low), known = validity[pixel];
        if (known || best >= UNMATCHED) {
            disparity_out[pixel] = NAN;
            lowest_out[pixel] = UNMATCHED;
            ratio_out[pixel] = 1.0f;
            validity_out[pixel] = known ? known : OUT_OF_RANGE;
            continue;
        }
        ushorts place = NONE, elsewhere = NONE;
        for (int i = 0; i < disparities; i += SHORTS) {
            ushorts here = load_sums(own, i, disparities, room), index = NUMBERS(ushorts) + (ushort)i;
            index = here == (ushort)best ? index : (ushorts)NONE;
            place = index < place ? index : place;
        }
        int at = smallest_of(place);
        for (int i = 0; i < disparities; i += SHORTS) {
            // Places from the one before the winner on; what comes earlier is a large number.
            ushorts here = load_sums(own, i, disparities, room), away = NUMBERS(ushorts) + (ushort)(i - at + 1);
            here = away > (ushort)2 ? here : (ushorts)NONE;
            elsewhere = here < elsewhere ? here : elsewhere;
        }
        int before = at > 0 ? own[at - 1] : NONE, after = at < disparities - 1 ? own[at + 1] : NONE;
        disparity_out[pixel] = lowest_disparity(at, best, before, after, smallest, subpixel);
        lowest_out[pixel] = best;
        ratio_out[pixel] = sums_ratio(best, smallest_of(elsewhere));
        validity_out[pixel] = 0;
    }
}
