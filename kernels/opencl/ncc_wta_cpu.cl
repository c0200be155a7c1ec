// Correlation and winner takes all in one pass that never holds the volume: the form for CPUs.
//
// A work-item owns a strip of rows and takes it in blocks of columns, whose sums fit a second-level cache. Column
// sums of products run down the strip, box sums along the row; both lie with the disparities side by side, so that
// every vector instruction works on LANES disparities of one pixel. Columns count in the direction in which the
// other view's match walks forward, which for the left view as reference is from the right edge to the left.
#include "lanes.h"
#include "peaks.h"

#define GROUP 2 // pixels that share a walk over the disparities; with more, the walk itself gets slower
#define TILE LANES // pixels whose keys are held until their winners and the other view's are taken
// A call would copy a strip and keep vectors out of registers.
#define INLINE inline __attribute__((always_inline))
typedef short shorts __attribute__((vector_size(4 * LANES)));

// A row's beginning is cold when the row's turn comes: its address is too far from the last row's for the hardware
// to foresee.
#ifdef __x86_64__
#define FETCH(address) __builtin_prefetch((const void *)(size_t)(address))
#else
#define FETCH(address)
#endif

// The picture's column at walking position p.
INLINE int column_at(int p, int width, int direction) { return direction > 0 ? p : width - 1 - p; }

INLINE lanes reversed(lanes v)
{
#if LANES == 16
    return __builtin_shufflevector(v, v, 15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0);
#else
    return __builtin_shufflevector(v, v, 7, 6, 5, 4, 3, 2, 1, 0);
#endif
}

// Walking positions p .. p + LANES - 1 of a row: beyond its ends its edge repeated, or 0.
INLINE lanes load_row(__global const float *row, int p, int width, int direction, int zero)
{
    if (p >= 0 && p + LANES <= width) {
        if (direction < 0) return reversed(*(__global const lanes *)(row + width - LANES - p));
        FETCH(row + width + p);
        return *(__global const lanes *)(row + p);
    }
    float values[LANES];
    for (int k = 0; k < LANES; k++) {
        int at = p + k;
        values[k] = zero && (at < 0 || at >= width) ? 0.0f : row[column_at(clamp_index(at, width), width, direction)];
    }
    return *(const lanes *)values;
}

// Store to walking positions p .. p + LANES - 1 of a row those that lie in the picture.
INLINE void store_row(lanes v, __global float *row_out, int p, int width, int direction)
{
    if (p + LANES <= width) {
        if (direction > 0) *(__global lanes *)(row_out + p) = v;
        else *(__global lanes *)(row_out + width - LANES - p) = reversed(v);
        return;
    }
    for (int k = 0; p + k < width; k++) row_out[column_at(p + k, width, direction)] = v[k];
}

// Two whole numbers of 16 bits a lane, first below second.
INLINE int_lanes pair(lanes first, lanes second)
{
    return (__builtin_convertvector(first, int_lanes) & 0xffff) | (__builtin_convertvector(second, int_lanes) << 16);
}

// first x first + second x second of every lane, which x86 has one instruction for.
#define WORDS(pairs) __builtin_astype(pairs, shorts)
INLINE int_lanes pair_product(int_lanes a, int_lanes b)
{
#if defined(__AVX512BW__)
    return __builtin_astype(__builtin_ia32_pmaddwd512(WORDS(a), WORDS(b)), int_lanes);
#elif defined(__AVX2__)
    return __builtin_astype(__builtin_ia32_pmaddwd256(WORDS(a), WORDS(b)), int_lanes);
#else
    return (a << 16 >> 16) * (b << 16 >> 16) + (a >> 16) * (b >> 16);
#endif
}

// Lanes 1 .. LANES of two vectors that follow one another.
#if LANES == 16
#define FOLLOWING(a, b) __builtin_shufflevector(a, b, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16)
#else
#define FOLLOWING(a, b) __builtin_shufflevector(a, b, 1, 2, 3, 4, 5, 6, 7, 8)
#endif

// Set so many numbers, a multiple of LANES, to 0.
INLINE void clear(__global int *numbers, int count)
{
    for (int k = 0; k < count; k += LANES) *(__global int_lanes *)(numbers + k) = (int_lanes)(0);
}

INLINE int_lanes larger(int_lanes a, int_lanes b) { return a > b ? a : b; }

INLINE int_lanes smaller(int_lanes a, int_lanes b) { return a < b ? a : b; }

// Two rows whose lanes hold largest values of 1, 2, 4 or 8 lanes become one of 2, 4, 8 or 16.
#if LANES == 16
#define PICK __builtin_shufflevector
#define MERGE_1(a, b)                                                        \
    larger(PICK(a, b, 0, 16, 2, 18, 4, 20, 6, 22, 8, 24, 10, 26, 12, 28, 14, 30), \
           PICK(a, b, 1, 17, 3, 19, 5, 21, 7, 23, 9, 25, 11, 27, 13, 29, 15, 31))
#define MERGE_2(a, b)                                                        \
    larger(PICK(a, b, 0, 1, 16, 17, 4, 5, 20, 21, 8, 9, 24, 25, 12, 13, 28, 29), \
           PICK(a, b, 2, 3, 18, 19, 6, 7, 22, 23, 10, 11, 26, 27, 14, 15, 30, 31))
#define MERGE_4(a, b)                                                        \
    larger(PICK(a, b, 0, 1, 2, 3, 16, 17, 18, 19, 8, 9, 10, 11, 24, 25, 26, 27), \
           PICK(a, b, 4, 5, 6, 7, 20, 21, 22, 23, 12, 13, 14, 15, 28, 29, 30, 31))
#define MERGE_8(a, b)                                                        \
    larger(PICK(a, b, 0, 1, 2, 3, 4, 5, 6, 7, 16, 17, 18, 19, 20, 21, 22, 23), \
           PICK(a, b, 8, 9, 10, 11, 12, 13, 14, 15, 24, 25, 26, 27, 28, 29, 30, 31))
#else
#define MERGE_1(a, b)                                              \
    larger(__builtin_shufflevector(a, b, 0, 8, 2, 10, 4, 12, 6, 14), \
           __builtin_shufflevector(a, b, 1, 9, 3, 11, 5, 13, 7, 15))
#define MERGE_2(a, b)                                              \
    larger(__builtin_shufflevector(a, b, 0, 1, 8, 9, 4, 5, 12, 13), \
           __builtin_shufflevector(a, b, 2, 3, 10, 11, 6, 7, 14, 15))
#define MERGE_4(a, b)                                              \
    larger(__builtin_shufflevector(a, b, 0, 1, 2, 3, 8, 9, 10, 11), \
           __builtin_shufflevector(a, b, 4, 5, 6, 7, 12, 13, 14, 15))
#endif
// Row t's largest value in lane t, of LANES rows. Rows are merged in pairs, so that each step halves their number
// and keeps all lanes at work.
INLINE int_lanes largest_of_rows(__global const int_lanes *rows)
{
    int_lanes held[LANES];
    UNROLL
    for (int t = 0; t < LANES; t += 2) held[t / 2] = MERGE_1(rows[t], rows[t + 1]);
    UNROLL
    for (int t = 0; t < LANES / 2; t += 2) held[t / 2] = MERGE_2(held[t], held[t + 1]);
    UNROLL
    for (int t = 0; t < LANES / 4; t += 2) held[t / 2] = MERGE_4(held[t], held[t + 1]);
#if LANES == 16
    held[0] = MERGE_8(held[0], held[1]);
#endif
    return held[0];
}

// What a strip works on; every part begins at a multiple of 64 bytes.
typedef struct {
    int padded, pitch, key_row;     // disparities, and the lengths of a row of sums and of keys
    int bits, mask;                 // of an index in a key
    __global int *sums;             // column sums of products, disparities side by side, a row a column
    __global int *box;              // their sum over the window's columns
    __global int *indices;          // the index's part of every disparity's key
    __global int *keys;             // a row a pixel of the tile, with zeros on either side
    __global int *ours, *theirs;    // the rows that enter and leave the window, as pairs
    __global float *sum_u, *inverse_u, *mean_x, *inverse_x; // of the other view's windows and of ours
    __global int *key_u;            // the other view's best keys
    __global int_lanes *highest, *seconds; // lane by lane the two best keys of every pixel of the tile
    __global int *places, *befores, *afters;
} Strip;

// Lay out a strip's scratch for blocks of so many columns; kernels/geometry.py computes the same size.
INLINE Strip lay_out(__global float *scratch, int strip, int block, int disparities, int radius)
{
    Strip s;
    s.padded = (disparities + LANES - 1) / LANES * LANES;
    s.pitch = s.padded + 16; // at a multiple of 4096 bytes, stores and loads of different pixels would look alike
    s.key_row = s.padded + 2 * (TILE + LANES);
    s.bits = index_bits(disparities);
    s.mask = (1 << s.bits) - 1;
    int columns = block + 2 * radius, span = (columns + s.padded + LANES) / 16 * 16 + 16;
    int length = s.pitch * (columns + 2) + TILE * s.key_row + 5 * span + 2 * block + (2 * TILE + 3) * LANES;
    s.sums = (__global int *)scratch + (long)strip * length;
    s.box = s.sums + s.pitch * columns;
    s.indices = s.box + s.pitch;
    s.keys = s.indices + s.pitch + TILE + LANES;
    s.ours = s.indices + s.pitch + TILE * s.key_row;
    s.theirs = s.ours + span;
    s.key_u = s.theirs + span;
    s.sum_u = (__global float *)(s.key_u + span);
    s.inverse_u = s.sum_u + span;
    s.mean_x = s.inverse_u + span;
    s.inverse_x = s.mean_x + block;
    s.highest = (__global int_lanes *)(s.inverse_x + block);
    s.seconds = s.highest + TILE;
    s.places = (__global int *)(s.seconds + TILE);
    s.befores = s.places + TILE;
    s.afters = s.befores + TILE;
    clear(s.keys - TILE - LANES, TILE * s.key_row);
    // Beyond the last disparity a key is negative, whatever its score.
    for (int i = 0; i < s.padded; i++) s.indices[i] = i < disparities ? s.mask - i : s.mask - i | INT_MIN;
    return s;
}

// Add a row's products to the sums of column c, and to the box where it is wanted.
INLINE void add_products(Strip s, int c, int with_box)
{
    int_lanes own = (int_lanes)(s.ours[c]);
    for (int i = 0; i < s.padded; i += LANES) {
        __global int_lanes *sum = (__global int_lanes *)(s.sums + c * s.pitch + i);
        *sum += pair_product(own, *(__global const int_lanes *)(s.theirs + c + i));
        if (with_box) *(__global int_lanes *)(s.box + i) += *sum;
    }
}

// Correlate GROUP pixels, from x on, at the first `searched` disparities; t is their place in the tile.
INLINE void correlate(Strip s, int x, int t, int searched, int radius)
{
    int_lanes own[GROUP], high[GROUP], second[GROUP];
    lanes mean[GROUP], inverse[GROUP];
    __global int *column = s.sums + (x + 2 * radius) * s.pitch, *key = s.keys + t * s.key_row;
    __global const int *gone = s.sums + x * s.pitch, *their = s.theirs + x + 2 * radius;
    __global const float *their_sum = s.sum_u + x, *their_inverse = s.inverse_u + x;
    UNROLL
    for (int g = 0; g < GROUP; g++) {
        own[g] = (int_lanes)(s.ours[x + 2 * radius + g]);
        mean[g] = (lanes)(s.mean_x[x + g]);
        inverse[g] = (lanes)(s.inverse_x[x + g]);
        high[g] = second[g] = (int_lanes)(0);
    }
    int_lanes pairs[GROUP + 1];
    lanes sums[GROUP + 1], inverses[GROUP + 1];
    // The last of each is the first of the next walk's. Only the first pixel's vectors are loaded: most would lie
    // across two cache lines.
    pairs[GROUP] = *(__global const int_lanes *)their;
    sums[GROUP] = *(__global const lanes *)their_sum;
    inverses[GROUP] = *(__global const lanes *)their_inverse;
    for (int i = 0; i < searched; i += LANES) {
        pairs[0] = pairs[GROUP];
        sums[0] = sums[GROUP];
        inverses[0] = inverses[GROUP];
        pairs[GROUP] = *(__global const int_lanes *)(their + i + LANES);
        sums[GROUP] = *(__global const lanes *)(their_sum + i + LANES);
        inverses[GROUP] = *(__global const lanes *)(their_inverse + i + LANES);
        pairs[1] = FOLLOWING(pairs[0], pairs[GROUP]);
        sums[1] = FOLLOWING(sums[0], sums[GROUP]);
        inverses[1] = FOLLOWING(inverses[0], inverses[GROUP]);
        int_lanes sum = *(__global int_lanes *)(s.box + i);
        int_lanes index = *(__global const int_lanes *)(s.indices + i);
        UNROLL
        for (int g = 0; g < GROUP; g++) {
            __global int_lanes *below = (__global int_lanes *)(column + g * s.pitch + i);
            *below += pair_product(own[g], pairs[g]);
            sum += *below;
            // This order of operations is the same in every form of the correlation, so that all agree.
            lanes score = ((__builtin_convertvector(sum, lanes) - mean[g] * sums[g]) * inverse[g]) * inverses[g];
            int_lanes k = (__builtin_convertvector(score, int_lanes) & ~s.mask) | index;
            *(__global int_lanes *)(key + g * s.key_row + i) = k;
            second[g] = larger(second[g], smaller(high[g], k));
            high[g] = larger(high[g], k);
            sum -= *(__global const int_lanes *)(gone + g * s.pitch + i);
        }
        *(__global int_lanes *)(s.box + i) = sum;
    }
    UNROLL
    for (int g = 0; g < GROUP; g++) {
        s.highest[t + g] = high[g];
        s.seconds[t + g] = second[g];
    }
}

// Store the winners of a tile's pixels, from walking position p on, to their row.
INLINE void take_winners(
    Strip s, int p, int length, int width, int direction, int smallest, int subpixel, __global const uchar *validity,
    __global float *disparity_out, __global float *score_out, __global float *ratio_out, __global uchar *validity_out)
{
    int_lanes best = largest_of_rows(s.highest), place = best > s.mask ? best & s.mask : s.mask;
    *(__global int_lanes *)s.places = place;
    // The runner-up is not the winner's neighbour; a lane holds at most one of the three.
    UNROLL
    for (int t = 0; t < TILE; t++) {
        int_lanes away = (int_lanes)(s.places[t] + 1) - (s.highest[t] & s.mask);
        s.highest[t] = away >= 0 && away <= 2 ? s.seconds[t] : s.highest[t];
    }
    int_lanes runner = largest_of_rows(s.highest) >> s.bits;
    for (int t = 0; t < TILE; t++) {
        __global const int *key = s.keys + t * s.key_row + s.mask - s.places[t];
        s.befores[t] = key[-1];
        s.afters[t] = key[1];
    }
    int_lanes before = *(__global int_lanes *)s.befores >> s.bits, after = *(__global int_lanes *)s.afters >> s.bits;
    best >>= s.bits;
    lanes level = __builtin_convertvector(best, lanes);
    lanes bend = __builtin_convertvector((before - best) + (after - best), lanes);
    lanes part = 0.5f * __builtin_convertvector(before - after, lanes) / bend;
    lanes value = __builtin_convertvector(s.mask - place + smallest, lanes);
    value += subpixel && before > 0 && after > 0 ? part : 0.0f;
    lanes ratio = __builtin_convertvector(runner, lanes) / level;
    store_row(level / score_scale(s.bits), score_out, p, width, direction);
    store_row(best > 0 ? value : NAN, disparity_out, p, width, direction);
    store_row(best > 0 ? ratio : 0.0f, ratio_out, p, width, direction);
    if (direction > 0 && p + TILE <= width) {
        int_lanes given = __builtin_convertvector(*(__global const uchar_lanes *)(validity + p), int_lanes);
        given = best > 0 || given != 0 ? given : OUT_OF_RANGE;
        *(__global uchar_lanes *)(validity_out + p) = __builtin_convertvector(given, uchar_lanes);
        return;
    }
    *(__global int_lanes *)s.places = best;
    for (int t = 0; t < length; t++) {
        int x = column_at(p + t, width, direction);
        validity_out[x] = s.places[t] > 0 || validity[x] ? validity[x] : OUT_OF_RANGE;
    }
}

// Load a row's sums and norms: of the other view from walking position p_other on, of ours from p on.
INLINE void load_norms(
    Strip s, int p, int p_other, int tiles, float count, int width, int direction, __global const float *reference_sum,
    __global const float *reference_inverse, __global const float *other_sum, __global const float *other_inverse)
{
    for (int k = 0; k < tiles + s.padded; k += LANES) {
        *(__global lanes *)(s.sum_u + k) = load_row(other_sum, p_other + k, width, direction, 1);
        *(__global lanes *)(s.inverse_u + k) = load_row(other_inverse, p_other + k, width, direction, 1);
        *(__global int_lanes *)(s.key_u + k) = (int_lanes)(0);
    }
    for (int k = 0; k < tiles; k += LANES) {
        *(__global lanes *)(s.mean_x + k) = load_row(reference_sum, p + k, width, direction, 0) / count;
        // A score of 1 becomes 2^30, so that its level is what is left above the bits of the index.
        *(__global lanes *)(s.inverse_x + k) = load_row(reference_inverse, p + k, width, direction, 1) * 1073741824.0f;
    }
}

// Of the keys of the tile at column x the best ones for each pixel of the other view.
INLINE void gather_others(Strip s, int x, int searched)
{
    for (int k = 0; k < searched + TILE; k += LANES) {
        __global int_lanes *held = (__global int_lanes *)(s.key_u + x + k);
        int_lanes high = *held;
        UNROLL
        for (int t = 0; t < TILE; t++)
            high = larger(high, *(__global const int_lanes *)(s.keys + t * s.key_row + k - t));
        *held = high;
    }
}

// Merge the other view's best keys, from walking position p on, into its row.
INLINE void merge_others(Strip s, int p, int length, int width, int direction, __global int *other_out)
{
    for (int k = 0; k < length; k += LANES) {
        int_lanes key = *(__global const int_lanes *)(s.key_u + k);
        if (direction > 0 && p + k >= 0 && p + k + LANES <= width) {
            FETCH(other_out + width + p + k);
            __global int_lanes *held = (__global int_lanes *)(other_out + p + k);
            *held = larger(*held, key > s.mask ? key : 0);
            continue;
        }
        for (int j = k; j < k + LANES; j++) {
            if (p + j < 0 || p + j >= width || s.key_u[j] <= s.mask) continue;
            __global int *held = other_out + column_at(p + j, width, direction);
            *held = s.key_u[j] > *held ? s.key_u[j] : *held;
        }
    }
}

// What ncc_volume followed by wta computes, without the volume; other_out must come in as 0.
__kernel void ncc_wta(
    // In:
    __global const float *reference,
    __global const float *other,
    __global const float *reference_sum,
    __global const float *reference_inverse,
    __global const float *other_sum,
    __global const float *other_inverse,
    __global const uchar *validity,
    int width,
    int height,
    int smallest,
    int disparities,
    int radius,
    int direction,
    int subpixel,
    int rows,
    __global float *scratch,
    // Out:
    __global float *disparity_out,
    __global float *score_out,
    __global float *ratio_out,
    __global uchar *validity_out,
    __global int *other_out)
{
    int strip = get_global_id(0), first = strip * rows;
    if (first >= height) return;
    int last = first + rows < height ? first + rows : height;
    float count = (float)((2 * radius + 1) * (2 * radius + 1));
    int padded = (disparities + LANES - 1) / LANES * LANES;
    // As wide as leaves the sums in a cache of 256 KiB; the same in kernels/geometry.py, for 16 lanes.
    int wide = 65536 / ((disparities + 15) / 16 * 16) / 16 * 16, widest = wide < 64 ? 64 : wide < 640 ? wide : 640;
    Strip s = lay_out(scratch, strip, widest, disparities, radius);

    for (int start = 0; start < width; start += widest) {
        int block = start + widest < width ? widest : width - start;
        int tiles = (block + TILE - 1) / TILE * TILE, used = tiles + 2 * radius;
        clear(s.sums, s.pitch * used);

        for (int y = first - 2 * radius; y < last; y++) {
            int row_in = clamp_index(y + radius, height) * width;
            // The row that left the window when it moved down to y; before the first row nothing has.
            int row_out = clamp_index(y - radius - 1, height) * width;
            for (int k = 0; k < used; k += LANES) {
                lanes in = load_row(reference + row_in, start - radius + k, width, direction, 0);
                lanes out = load_row(reference + row_out, start - radius + k, width, direction, 0);
                *(__global int_lanes *)(s.ours + k) = pair(in, y > first ? -out : 0.0f);
            }
            for (int k = 0; k < used + padded; k += LANES) {
                lanes in = load_row(other + row_in, start - radius + smallest + k, width, direction, 0);
                lanes out = load_row(other + row_out, start - radius + smallest + k, width, direction, 0);
                *(__global int_lanes *)(s.theirs + k) = pair(in, out);
            }
            if (y < first) {
                for (int c = 0; c < used; c++) add_products(s, c, 0);
                continue;
            }
            int row = y * width, searched = padded;
            load_norms(s, start, start + smallest, tiles, count, width, direction, reference_sum + row,
                       reference_inverse + row, other_sum + row, other_inverse + row);
            clear(s.box, padded);
            for (int c = 0; c < 2 * radius; c++) add_products(s, c, 1);
            for (int x = 0; x < block; x += TILE) {
                // Beyond the other picture's end nothing correlates, here or further on.
                while (searched > 0 && start + x + smallest + searched - LANES >= width) {
                    searched -= LANES;
                    for (int t = 0; t < TILE; t++)
                        *(__global int_lanes *)(s.keys + t * s.key_row + searched) = (int_lanes)(0);
                }
                for (int t = 0; t < TILE; t += GROUP)
                    correlate(s, x + t, t, searched, radius);
                take_winners(s, start + x, block - x < TILE ? block - x : TILE, width, direction, smallest, subpixel,
                             validity + row, disparity_out + row, score_out + row, ratio_out + row, validity_out + row);
                gather_others(s, x, searched);
            }
            merge_others(s, start + smallest, tiles + padded, width, direction, other_out + row);
        }
    }
}
