// Cost of every pixel at every disparity: the form for CPUs.
//
// A work-item owns a band of rows. Every vector holds one pixel's costs at neighbouring disparities: those of
// neighbouring pixels of the other view, whose two times 31 bits are taken as one number.
#include "lanes.h"
#define MASKED 16
#define NO_MATCH 255
#define UNSEEN 254
#define PAIRS (LANES / 2)
typedef ulong pair_lanes __attribute__((ext_vector_type(PAIRS), aligned(4)));
typedef uchar cost_lanes __attribute__((ext_vector_type(PAIRS), aligned(1)));
#ifdef __AVX2__
typedef char bytes __attribute__((vector_size(8 * PAIRS)));
#endif

// Number of ones in each.
inline pair_lanes count_ones(pair_lanes bits)
{
#ifdef __AVX2__
    // How many ones each number of four bits has; bytes are looked up by halves.
    pair_lanes few = 0x0302020102010100ul, many = 0x0403030203020201ul;
#if LANES == 16
    bytes ones = __builtin_astype((pair_lanes)(few.x, many.x, few.x, many.x, few.x, many.x, few.x, many.x), bytes);
    bytes low = __builtin_ia32_pshufb512(ones, __builtin_astype(bits & 0x0f0f0f0f0f0f0f0ful, bytes));
    bytes high = __builtin_ia32_pshufb512(ones, __builtin_astype(bits >> 4 & 0x0f0f0f0f0f0f0f0ful, bytes));
    return __builtin_astype(__builtin_ia32_psadbw512(low + high, low - low), pair_lanes);
#else
    bytes ones = __builtin_astype((pair_lanes)(few.x, many.x, few.x, many.x), bytes);
    bytes low = __builtin_ia32_pshufb256(ones, __builtin_astype(bits & 0x0f0f0f0f0f0f0f0ful, bytes));
    bytes high = __builtin_ia32_pshufb256(ones, __builtin_astype(bits >> 4 & 0x0f0f0f0f0f0f0f0ful, bytes));
    return __builtin_astype(__builtin_ia32_psadbw256(low + high, low - low), pair_lanes);
#endif
#else
    pair_lanes twos = bits - (bits >> 1 & 0x5555555555555555ul);
    pair_lanes fours = (twos & 0x3333333333333333ul) + (twos >> 2 & 0x3333333333333333ul);
    pair_lanes eights = fours + (fours >> 4) & 0x0f0f0f0f0f0f0f0ful;
    return eights * 0x0101010101010101ul >> 56;
#endif
}

// Costs of disparities i to i + PAIRS - 1, whose other pixels are u, u + direction and on.
inline void compare(
    ulong own, __global const int *bits, __global const uchar *reasons, int u, int direction, __global uchar *cost)
{
    int from = direction > 0 ? u : u - (PAIRS - 1);
    pair_lanes ones = count_ones(*(__global const pair_lanes *)(bits + from * 2) ^ own);
    cost_lanes masked = __builtin_astype(*(__global const cost_lanes *)(reasons + from) == (uchar)MASKED, cost_lanes);
    cost_lanes costs = __builtin_convertvector(ones, cost_lanes) | masked;
    if (direction < 0)
#if LANES == 16
        costs = __builtin_shufflevector(costs, costs, 7, 6, 5, 4, 3, 2, 1, 0);
#else
        costs = __builtin_shufflevector(costs, costs, 3, 2, 1, 0);
#endif
    *(__global cost_lanes *)cost = costs;
}

// The same for one disparity.
inline void compare_one(ulong own, __global const int *bits, __global const uchar *reasons, int u, __global uchar *cost)
{
    ulong theirs = (ulong)(uint)bits[u * 2] | (ulong)(uint)bits[u * 2 + 1] << 32;
    pair_lanes ones = count_ones((pair_lanes)(theirs ^ own));
    *cost = reasons[u] == MASKED ? NO_MATCH : (uchar)ones[0];
}

// What census_volume.cl computes.
__kernel void census_volume(
    // In:
    __global const int *reference_bits,
    __global const int *other_bits,
    __global const uchar *reference_validity,
    __global const uchar *other_validity,
    int width,
    int height,
    int smallest,
    int disparities,
    int direction,
    // Out:
    __global uchar *cost_out)
{
    int2 rows = band_of_rows(height);
    for (int y = rows.x; y < rows.y; y++) {
        __global const int *bits = other_bits + (long)y * width * 2;
        __global const uchar *reasons = other_validity + (long)y * width;
        for (int x = 0; x < width; x++) {
            long pixel = (long)y * width + x;
            __global uchar *cost = cost_out + pixel * disparities;
            if (reference_validity[pixel] == MASKED) {
                for (int i = 0; i < disparities; i++) cost[i] = NO_MATCH;
                continue;
            }
            // From first to last - 1 the other pixel is inside of the picture.
            int zero = x + direction * smallest; // the other pixel at the first disparity
            int first = clamp_index(direction > 0 ? -zero : zero - width + 1, disparities + 1);
            int last = clamp_index(direction > 0 ? width - zero : zero + 1, disparities + 1);
            for (int i = 0; i < first; i++) cost[i] = UNSEEN;
            for (int i = last > first ? last : first; i < disparities; i++) cost[i] = UNSEEN;
            ulong own = (ulong)(uint)reference_bits[pixel * 2] | (ulong)(uint)reference_bits[pixel * 2 + 1] << 32;
            if (last - first < PAIRS) {
                for (int i = first; i < last; i++) compare_one(own, bits, reasons, zero + direction * i, cost + i);
                continue;
            }
            // The last costs overlap with those before.
            for (int i = first; i < last; i += PAIRS) {
                int at = i + PAIRS <= last ? i : last - PAIRS;
                compare(own, bits, reasons, zero + direction * at, direction, cost + at);
            }
        }
    }
}
