// Cost of every pixel at every disparity: the form for CPUs.
//
// A work-item owns a band of rows. Of the other row it keeps a piece apart into bytes, in the order in which disparities
// grow, so that the costs of one pixel at SIDE neighbouring disparities are one vector of bytes.
#include "lanes.h"
#define INLINE inline __attribute__((always_inline))
#define MASKED 16
#define NO_MATCH 255
#define UNSEEN 96
#define SIDE (4 * LANES)
// Columns and disparities that the piece is for.
#define COLUMNS 512
#define RANGE 512
#define PIECE (COLUMNS + RANGE + SIDE + LANES)
typedef uchar costs __attribute__((ext_vector_type(SIDE), aligned(1)));
typedef ushort wide_costs __attribute__((ext_vector_type(SIDE)));
#ifdef __AVX2__
typedef char bytes __attribute__((vector_size(SIDE)));
#endif

// Planes of the piece: three bytes of bits, three of the guide, where the cost counts, and what stands elsewhere.
enum { BITS, GUIDE = 3, COUNTS = 6, ELSE, PLANES };

#ifdef __AVX2__
// For each byte of v, 0..15, what stands there in the list.
INLINE costs look_up(uchar16 list, costs v)
{
#if LANES == 16
    costs four = __builtin_shufflevector(list, list, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 0, 1, 2, 3,
                                         4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11,
                                         12, 13, 14, 15, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    return __builtin_astype(
        __builtin_ia32_pshufb512(__builtin_astype(four, bytes), __builtin_astype(v, bytes)), costs);
#else
    costs two = __builtin_shufflevector(list, list, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 0, 1, 2, 3, 4,
                                        5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    return __builtin_astype(
        __builtin_ia32_pshufb256(__builtin_astype(two, bytes), __builtin_astype(v, bytes)), costs);
#endif
}
#endif

// Number of ones in each byte.
INLINE costs count_ones(costs v)
{
#ifdef __AVX2__
    uchar16 ones = (uchar16)(0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4);
    return look_up(ones, v & (uchar)15) + look_up(ones, v >> (uchar)4 & (uchar)15);
#else
    costs twos = v - (v >> (uchar)1 & (uchar)0x55);
    costs fours = (twos & (uchar)0x33) + (twos >> (uchar)2 & (uchar)0x33);
    return fours + (fours >> (uchar)4) & (uchar)15;
#endif
}

// How far apart bytes are.
INLINE costs distance(costs a, costs b) { return a > b ? a - b : b - a; }

// a + b, and no more than the largest byte.
INLINE costs add_some(costs a, costs b)
{
    costs sum = a + b;
    return sum < a ? (costs)(255) : sum;
}

// The cost of pixels whose bits and guide stand at `piece`, against those of our pixel.
INLINE costs compare(const uchar *piece, const uchar *own)
{
    costs a = *(const costs *)(piece + BITS * PIECE) ^ own[BITS];
    costs b = *(const costs *)(piece + (BITS + 1) * PIECE) ^ own[BITS + 1];
    costs c = *(const costs *)(piece + (BITS + 2) * PIECE) ^ own[BITS + 2];
    // Three bits add up to a bit and a carry, so that two bytes are counted and not three.
    costs bits = count_ones(a & b | c & (a | b));
    bits = bits + bits + count_ones(a ^ b ^ c);
    costs apart = distance(*(const costs *)(piece + GUIDE * PIECE), own[GUIDE]);
    apart = add_some(apart, distance(*(const costs *)(piece + (GUIDE + 1) * PIECE), own[GUIDE + 1]));
    apart = add_some(apart, distance(*(const costs *)(piece + (GUIDE + 2) * PIECE), own[GUIDE + 2]));
    apart = apart < (uchar)48 ? apart : (costs)(48);
    wide_costs h = __builtin_convertvector(bits, wide_costs), s = __builtin_convertvector(apart, wide_costs);
    h = h * ((ushort)48 - h) * (ushort)45 >> (ushort)8;
    s = s * ((ushort)96 - s) * (ushort)5 >> (ushort)8;
    costs cost = __builtin_convertvector(h + s, costs);
    return cost & *(const costs *)(piece + COUNTS * PIECE) | *(const costs *)(piece + ELSE * PIECE);
}

// Lay out pixel u of a row, which may lie outside of the picture, at place k.
INLINE void lay_out(
    uchar *piece, int k, int u, int width, long plane, __global const int *bits, __global const uchar *guide,
    __global const uchar *reasons)
{
    int seen = u >= 0 && u < width, at = clamp_index(u, width), masked = reasons[at] == MASKED;
    for (int c = 0; c < 3; c++) {
        piece[(BITS + c) * PIECE + k] = bits[at] >> 8 * c;
        piece[(GUIDE + c) * PIECE + k] = guide[c * plane + at];
    }
    piece[COUNTS * PIECE + k] = seen && !masked ? 255 : 0;
    piece[ELSE * PIECE + k] = seen ? masked ? NO_MATCH : 0 : UNSEEN;
}

// Pixels that stand by rising u in the order in which they are walked.
INLINE uchar_lanes in_order(uchar_lanes v, int direction)
{
    if (direction > 0) return v;
#if LANES == 16
    return __builtin_shufflevector(v, v, 15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0);
#else
    return __builtin_shufflevector(v, v, 7, 6, 5, 4, 3, 2, 1, 0);
#endif
}

// Lay out LANES pixels from u on, all in the picture, at place k.
INLINE void lay_out_lanes(
    uchar *piece, int k, int u, int direction, long plane, __global const int *bits, __global const uchar *guide,
    __global const uchar *reasons)
{
    int from = direction > 0 ? u : u - (LANES - 1);
    int_lanes held = *(__global const int_lanes *)(bits + from);
    UNROLL
    for (int c = 0; c < 3; c++) {
        uchar_lanes byte = __builtin_convertvector(held >> 8 * c & 255, uchar_lanes);
        uchar_lanes level = *(__global const uchar_lanes *)(guide + c * plane + from);
        *(uchar_lanes *)(piece + (BITS + c) * PIECE + k) = in_order(byte, direction);
        *(uchar_lanes *)(piece + (GUIDE + c) * PIECE + k) = in_order(level, direction);
    }
    uchar_lanes masked = in_order(*(__global const uchar_lanes *)(reasons + from), direction);
    masked = __builtin_astype(masked == (uchar)MASKED, uchar_lanes);
    *(uchar_lanes *)(piece + COUNTS * PIECE + k) = ~masked;
    *(uchar_lanes *)(piece + ELSE * PIECE + k) = masked;
}

// What match_cost.cl computes.
__kernel __attribute__((min_vector_width(512))) void match_cost(
    // In:
    __global const int *reference_bits,
    __global const int *other_bits,
    __global const uchar *reference_guide,
    __global const uchar *other_guide,
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
    long plane = (long)width * height;
    __global uchar *end = cost_out + (long)rows.y * width * disparities;
    uchar piece[PLANES * PIECE] ALIGNED;
    for (int y = rows.x; y < rows.y; y++) {
        long row = (long)y * width;
        for (int start = 0; start < width; start += COLUMNS) {
            int columns = width - start < COLUMNS ? width - start : COLUMNS;
            // The last disparities first: a vector may reach into the next pixel's, which are written later.
            for (int low = (disparities - 1) / RANGE * RANGE; low >= 0; low -= RANGE) {
                int range = disparities - low < RANGE ? disparities - low : RANGE;
                // Walking on from `zero`, where the first disparity of the first pixel that is walked by lies.
                int zero = (direction > 0 ? start : start + columns - 1) + direction * (smallest + low);
                for (int k = 0; k < columns + range + SIDE; k += LANES) {
                    int u = zero + direction * k, last = u + direction * (LANES - 1);
                    if (u >= 0 && u < width && last >= 0 && last < width)
                        lay_out_lanes(piece, k, u, direction, plane, other_bits + row, other_guide + row,
                                      other_validity + row);
                    else
                        for (int j = 0; j < LANES; j++)
                            lay_out(piece, k + j, u + direction * j, width, plane, other_bits + row, other_guide + row,
                                    other_validity + row);
                }
                for (int x = start; x < start + columns; x++) {
                    __global uchar *cost = cost_out + (row + x) * disparities + low;
                    if (reference_validity[row + x] == MASKED) {
                        for (int i = 0; i < range; i++) cost[i] = NO_MATCH;
                        continue;
                    }
                    uchar own[6];
                    for (int c = 0; c < 3; c++) {
                        own[BITS + c] = reference_bits[row + x] >> 8 * c;
                        own[GUIDE + c] = reference_guide[c * plane + row + x];
                    }
                    const uchar *first = piece + (direction > 0 ? x - start : start + columns - 1 - x);
                    for (int i = 0; i < range; i += SIDE) {
                        costs found = compare(first + i, own);
                        if (end - (cost + i) >= SIDE)
                            *(__global costs *)(cost + i) = found;
                        else
                            for (int j = 0; i + j < range; j++) cost[i + j] = found[j];
                    }
                }
            }
        }
    }
}
