// Median of the valid neighbours: the form for CPUs.
//
// A work-item owns a band of rows and takes it in blocks of columns, with the rows under its window in a ring.
// Every lane of a vector is one pixel's selection, by compare and exchange alone.
#include "lanes.h"
#define LARGEST 7
#define WORDS (BLOCK / LANES / 64 + 1)
// Called, they would keep their values in memory.
#define INLINE inline __attribute__((always_inline))

// Order two values: one instruction for the lower, one for the higher.
#define O(a, b) \
    { \
        lanes low = v[a] < v[b] ? v[a] : v[b]; \
        v[b] = v[a] > v[b] ? v[a] : v[b]; \
        v[a] = low; \
    }

// The middle one of 9. Networks: J. L. Smith, Implementing median filters in XC4000E FPGAs, Xcell 23 (1996).
INLINE lanes middle_of_9(lanes *v)
{
    O(1, 2) O(4, 5) O(7, 8) O(0, 1) O(3, 4) O(6, 7) O(1, 2) O(4, 5) O(7, 8) O(0, 3) O(5, 8) O(4, 7) O(3, 6) O(1, 4)
    O(2, 5) O(4, 7) O(4, 2) O(6, 4) O(4, 2)
    return v[4];
}

INLINE lanes middle_of_25(lanes *v)
{
    O(0, 1) O(3, 4) O(2, 4) O(2, 3) O(6, 7) O(5, 7) O(5, 6) O(9, 10) O(8, 10) O(8, 9) O(12, 13) O(11, 13) O(11, 12)
    O(15, 16) O(14, 16) O(14, 15) O(18, 19) O(17, 19) O(17, 18) O(21, 22) O(20, 22) O(20, 21) O(23, 24) O(2, 5)
    O(3, 6) O(0, 6) O(0, 3) O(4, 7) O(1, 7) O(1, 4) O(11, 14) O(8, 14) O(8, 11) O(12, 15) O(9, 15) O(9, 12)
    O(13, 16) O(10, 16) O(10, 13) O(20, 23) O(17, 23) O(17, 20) O(21, 24) O(18, 24) O(18, 21) O(19, 22) O(8, 17)
    O(9, 18) O(0, 18) O(0, 9) O(10, 19) O(1, 19) O(1, 10) O(11, 20) O(2, 20) O(2, 11) O(12, 21) O(3, 21) O(3, 12)
    O(13, 22) O(4, 22) O(4, 13) O(14, 23) O(5, 23) O(5, 14) O(15, 24) O(6, 24) O(6, 15) O(7, 16) O(7, 19) O(13, 21)
    O(15, 23) O(7, 13) O(7, 15) O(1, 9) O(3, 11) O(5, 17) O(11, 17) O(9, 17) O(4, 10) O(6, 12) O(7, 14) O(4, 6)
    O(4, 7) O(12, 14) O(10, 14) O(6, 7) O(10, 12) O(6, 10) O(6, 17) O(12, 17) O(7, 17) O(7, 10) O(12, 18) O(7, 12)
    O(10, 18) O(12, 20) O(10, 20) O(10, 12)
    return v[12];
}

// Bring the lowest of v[first .. 25] to v[first], and put v[next] in the place of the highest.
#define DROP(first, next) \
    UNROLL for (int k = 0; k < (26 - (first)) / 2; k++) O((first) + k, 25 - k) \
    UNROLL for (int k = (first) + 1; k < ((first) + 27) / 2; k++) O(first, k) \
    UNROLL for (int k = ((first) + 26) / 2; k < 25; k++) O(k, 25) \
    v[25] = v[next];

// Of half the values and one more, neither the lowest nor the highest is the middle one of all: drop both, take in
// the next, and so on until one is left.
INLINE lanes middle_of_49(lanes *v)
{
    DROP(0, 26) DROP(1, 27) DROP(2, 28) DROP(3, 29) DROP(4, 30) DROP(5, 31) DROP(6, 32) DROP(7, 33) DROP(8, 34)
    DROP(9, 35) DROP(10, 36) DROP(11, 37) DROP(12, 38) DROP(13, 39) DROP(14, 40) DROP(15, 41) DROP(16, 42) DROP(17, 43)
    DROP(18, 44) DROP(19, 45) DROP(20, 46) DROP(21, 47) DROP(22, 48) O(23, 25) O(23, 24) O(24, 25)
    return v[24];
}

// The median of LANES windows side by side. Where any has no value, missing ones count in turn as lowest and
// highest, so that the middle of the whole window is the median of the rest.
#define MEDIAN(middle, size) \
    lanes v[(size) * (size)]; \
    UNROLL for (int k = 0; k < (size) * (size); k++) v[k] = *(lanes *)(ring[k / (size)] + x + k % (size)); \
    if (gap) { \
        int_lanes filler = (int_lanes)(as_int(-INFINITY)); \
        UNROLL for (int k = 0; k < (size) * (size); k++) { \
            int_lanes missing = v[k] != v[k]; \
            v[k] = missing ? __builtin_astype(filler, lanes) : v[k]; \
            filler = missing ? filler ^ (int_lanes)(1 << 31) : filler; \
        } \
    } \
    result = middle(v);

// Median over size x size (3, 5 or 7) neighbours that have a value; of an even number the lower one.
// A pixel without a value stays without.
__kernel void median(
    // In:
    __global const float *disparity,
    int width,
    int height,
    int size,
    // Out:
    __global float *disparity_out)
{
    int2 band = band_of_rows(height);
    int radius = size / 2;
    float ring[LARGEST][BLOCK + LANES] ALIGNED;
    float low[BLOCK + LANES] ALIGNED, middle[BLOCK + LANES] ALIGNED, high[BLOCK + LANES] ALIGNED; // of columns of three
    ulong incomplete[LARGEST][WORDS], gaps[WORDS]; // one bit a vector where a value is missing
    for (int start = 0; start < width; start += BLOCK) {
        int columns = start + BLOCK < width ? BLOCK : width - start, used = columns + 2 * radius;
        for (int y = band.x - radius; y < band.y + radius; y++) {
            int entering = (y - band.x + radius) % size;
            float *line = ring[entering];
            if (y >= 0 && y < height) {
                load_line(line, disparity + (long)y * width, start - radius, used, width, 0);
            } else {
                for (int k = 0; k < used; k += LANES) *(lanes *)(line + k) = (lanes)(NAN);
            }
            for (int word = 0, k = 0; word < WORDS; word++) {
                ulong bits = 0;
                for (int bit = 0; bit < 64 && k < used; bit++, k += LANES)
                    bits |= (ulong)any_lane(*(lanes *)(line + k) != *(lanes *)(line + k)) << bit;
                incomplete[entering][word] = bits;
            }
            if (y < band.x + radius) continue;
            for (int word = 0; word < WORDS; word++) {
                gaps[word] = 0;
                for (int k = 0; k < size; k++) gaps[word] |= incomplete[k][word];
            }
            for (int k = 0; size == 3 && k < used; k += LANES) {
                lanes v[3] = {*(lanes *)(ring[0] + k), *(lanes *)(ring[1] + k), *(lanes *)(ring[2] + k)};
                O(0, 1) O(1, 2) O(0, 1)
                *(lanes *)(low + k) = v[0];
                *(lanes *)(middle + k) = v[1];
                *(lanes *)(high + k) = v[2];
            }
            float *centre = ring[(entering + size - radius) % size] + radius;
            __global float *row_out = disparity_out + (long)(y - radius) * width;
            for (int x = 0; x < columns; x += LANES) {
                lanes value = *(lanes *)(centre + x), result;
                int first = x / LANES, second = first + 1;
                int gap = (gaps[first / 64] >> first % 64 | gaps[second / 64] >> second % 64) & 1;
                if (size == 3 && !gap) {
                    lanes v[9];
                    UNROLL for (int k = 0; k < 3; k++) {
                        v[k] = *(lanes *)(low + x + k);
                        v[3 + k] = *(lanes *)(middle + x + k);
                        v[6 + k] = *(lanes *)(high + x + k);
                    }
                    // The middle one of the highest low, the middle one of the middles, and the lowest high.
                    O(0, 1) O(1, 2) O(3, 4) O(4, 5) O(3, 4) O(6, 7) O(6, 8) O(2, 4) O(4, 6) O(2, 4)
                    result = v[4];
                } else if (size == 3) {
                    MEDIAN(middle_of_9, 3)
                } else if (size == 5) {
                    MEDIAN(middle_of_25, 5)
                } else {
                    MEDIAN(middle_of_49, 7)
                }
                store_lanes(row_out, start + x, width, value == value ? result : value);
            }
        }
    }
}
