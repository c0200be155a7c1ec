// Correlation and winner takes all in one pass that never holds the volume: the form for CPUs.
//
// A work-item owns a strip of rows and takes it in blocks of BLOCK columns. Column sums of products run down
// the strip, box sums along the row; both lie with the disparities side by side, so that every vector instruction
// works on LANES disparities of one pixel. Columns count in the direction in which the other view's match
// walks forward, which for the left view as reference is from the right edge to the left.
#include "peaks.h"

#ifdef __AVX512BW__
#define LANES 16
#else
#define LANES 8
#endif
#define BLOCK 64
#define TILE 16 // pixels whose keys are held until the other view has looked at them
typedef float lanes __attribute__((ext_vector_type(LANES), aligned(4)));
typedef int int_lanes __attribute__((ext_vector_type(LANES), aligned(4)));
typedef short short_pairs __attribute__((ext_vector_type(2 * LANES), aligned(4)));
typedef short shorts __attribute__((ext_vector_type(LANES)));

// The picture's column at walking position p.
inline int column_at(int p, int width, int direction) { return direction > 0 ? p : width - 1 - p; }

inline lanes reversed(lanes v)
{
#if LANES == 16
    return __builtin_shufflevector(v, v, 15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0);
#else
    return __builtin_shufflevector(v, v, 7, 6, 5, 4, 3, 2, 1, 0);
#endif
}

// Walking positions p .. p + LANES - 1 of a row: beyond its ends its edge repeated, or 0.
inline lanes load_row(__global const float *row, int p, int width, int direction, int zero)
{
    if (p >= 0 && p + LANES <= width)
        return direction > 0 ? *(__global const lanes *)(row + p)
                             : reversed(*(__global const lanes *)(row + width - LANES - p));
    lanes result;
    for (int k = 0; k < LANES; k++) {
        int at = p + k;
        result[k] = zero && (at < 0 || at >= width) ? 0.0f : row[column_at(clamp_index(at, width), width, direction)];
    }
    return result;
}

// Two whole numbers of 16 bits a lane, first below second.
inline int_lanes pair(lanes first, lanes second)
{
    return (__builtin_convertvector(first, int_lanes) & 0xffff) | (__builtin_convertvector(second, int_lanes) << 16);
}

// first x first + second x second of every lane: one instruction, which compilers recognise in this form.
inline int_lanes pair_product(int_lanes a, int_lanes b)
{
    short_pairs p = __builtin_astype(a, short_pairs), q = __builtin_astype(b, short_pairs);
    return __builtin_convertvector((shorts)p.even, int_lanes) * __builtin_convertvector((shorts)q.even, int_lanes)
           + __builtin_convertvector((shorts)p.odd, int_lanes) * __builtin_convertvector((shorts)q.odd, int_lanes);
}

inline int_lanes larger(int_lanes a, int_lanes b) { return a > b ? a : b; }

inline int_lanes smaller(int_lanes a, int_lanes b) { return a < b ? a : b; }

inline int largest(int_lanes v)
{
    int result = v[0];
    for (int k = 1; k < LANES; k++) result = v[k] > result ? v[k] : result;
    return result;
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
    int padded = (disparities + LANES - 1) / LANES * LANES, whole = disparities / LANES * LANES;
    int columns = BLOCK + 2 * radius, span = columns + padded + LANES, key_row = padded + 2 * (TILE + LANES);
    int bits = index_bits(disparities), mask = (1 << bits) - 1;
    float count = (float)((2 * radius + 1) * (2 * radius + 1)), scale = score_scale(bits);
    int_lanes counting;
    for (int k = 0; k < LANES; k++) counting[k] = k;

    // Scratch of this strip; kernels/geometry.py computes the same size.
    __global int *sums = (__global int *)scratch + (long)strip * (padded * (columns + 1) + TILE * key_row + 5 * span + 2 * BLOCK);
    __global int *box = sums + padded * columns;
    __global int *keys = box + padded + TILE + LANES; // a row of keys has zeros on either side
    __global int *ours = keys - TILE - LANES + TILE * key_row; // rows that enter and leave the window, as pairs
    __global int *theirs = ours + span;
    __global float *sum_u = (__global float *)(theirs + span);
    __global float *inverse_u = sum_u + span;
    __global int *key_u = (__global int *)(inverse_u + span);
    __global float *mean_x = (__global float *)(key_u + span);
    __global float *inverse_x = mean_x + BLOCK;
    for (int k = 0; k < TILE * key_row; k++) keys[k - TILE - LANES] = 0;

    for (int start = 0; start < width; start += BLOCK) {
        int block = start + BLOCK < width ? BLOCK : width - start;
        int used = block + 2 * radius;
        for (int k = 0; k < padded * used; k++) sums[k] = 0;

        for (int y = first - 2 * radius; y < last; y++) {
            int row_in = clamp_index(y + radius, height) * width;
            // The row that left the window when it moved down to y; before the first row nothing has.
            int row_out = clamp_index(y - radius - 1, height) * width;
            for (int k = 0; k < used; k += LANES) {
                int p = start - radius + k;
                lanes in = load_row(reference + row_in, p, width, direction, 0), out = (lanes)(0.0f);
                if (y > first) out = -load_row(reference + row_out, p, width, direction, 0);
                *(__global int_lanes *)(ours + k) = pair(in, out);
            }
            for (int k = 0; k < used + padded; k += LANES) {
                int p = start - radius + smallest + k;
                *(__global int_lanes *)(theirs + k) = pair(load_row(other + row_in, p, width, direction, 0),
                                                           load_row(other + row_out, p, width, direction, 0));
            }
            if (y < first) {
                for (int c = 0; c < used; c++) {
                    int_lanes own = (int_lanes)(ours[c]);
                    __global int *column = sums + c * padded;
                    for (int i = 0; i < padded; i += LANES)
                        *(__global int_lanes *)(column + i) += pair_product(own, *(__global int_lanes *)(theirs + c + i));
                }
                continue;
            }
            for (int k = 0; k < block + padded; k += LANES) {
                int p = start + smallest + k;
                *(__global lanes *)(sum_u + k) = load_row(other_sum + y * width, p, width, direction, 1);
                *(__global lanes *)(inverse_u + k) = load_row(other_inverse + y * width, p, width, direction, 1);
                *(__global int_lanes *)(key_u + k) = (int_lanes)(0);
            }
            for (int k = 0; k < block; k += LANES) {
                *(__global lanes *)(mean_x + k) =
                    load_row(reference_sum + y * width, start + k, width, direction, 0) / count;
                *(__global lanes *)(inverse_x + k) =
                    load_row(reference_inverse + y * width, start + k, width, direction, 0) * scale;
            }

            for (int i = 0; i < padded; i += LANES) *(__global int_lanes *)(box + i) = (int_lanes)(0);
            for (int c = 0; c < 2 * radius; c++) {
                int_lanes own = (int_lanes)(ours[c]);
                __global int *column = sums + c * padded;
                for (int i = 0; i < padded; i += LANES) {
                    int_lanes sum = *(__global int_lanes *)(column + i)
                                    + pair_product(own, *(__global int_lanes *)(theirs + c + i));
                    *(__global int_lanes *)(column + i) = sum;
                    *(__global int_lanes *)(box + i) += sum;
                }
            }
            for (int tile = 0; tile < block; tile += TILE) {
                int length = tile + TILE < block ? TILE : block - tile;
                for (int t = 0; t < length; t++) {
                    int x = tile + t, c = x + 2 * radius;
                    int_lanes own = (int_lanes)(ours[c]), high = (int_lanes)(0), second = (int_lanes)(0);
                    lanes mean = (lanes)(mean_x[x]), inverse = (lanes)(inverse_x[x]);
                    int_lanes index = (int_lanes)(mask) - counting;
                    __global int *column = sums + c * padded, *gone = sums + x * padded, *key_x = keys + t * key_row;
                    for (int i = 0; i < padded; i += LANES) {
                        int_lanes sum = *(__global int_lanes *)(column + i)
                                        + pair_product(own, *(__global int_lanes *)(theirs + c + i));
                        *(__global int_lanes *)(column + i) = sum;
                        sum += *(__global int_lanes *)(box + i);
                        *(__global int_lanes *)(box + i) = sum - *(__global int_lanes *)(gone + i);
                        // This order of operations is the same in every form of the correlation, so that all agree.
                        lanes score =
                            ((__builtin_convertvector(sum, lanes) - mean * *(__global lanes *)(sum_u + x + i)) * inverse)
                            * *(__global lanes *)(inverse_u + x + i);
                        int_lanes key = (__builtin_convertvector(score, int_lanes) << bits) + index;
                        if (i >= whole) key = index > mask - disparities ? key : 0;
                        *(__global int_lanes *)(key_x + i) = key;
                        second = larger(second, smaller(high, key));
                        high = larger(high, key);
                        index -= LANES;
                    }
                    int best = largest(high), at = mask - (best & mask);
                    // The runner-up is not the winner's neighbour; a lane holds at most one of the three.
                    int_lanes away = (best & mask) + 1 - (high & mask);
                    int runner = largest(away >= 0 && away <= 2 ? second : high) >> bits;
                    int before = at > 0 ? key_x[at - 1] >> bits : 0;
                    int after = at < disparities - 1 ? key_x[at + 1] >> bits : 0;
                    best >>= bits;
                    long pixel = (long)y * width + column_at(start + x, width, direction);
                    score_out[pixel] = (float)best / scale;
                    disparity_out[pixel] =
                        best > 0 ? peak_disparity(at, best, before, after, smallest, subpixel) : NAN;
                    ratio_out[pixel] = best > 0 ? (float)runner / (float)best : 0.0f;
                    validity_out[pixel] = best > 0 || validity[pixel] ? validity[pixel] : OUT_OF_RANGE;
                }
                for (int k = 0; k < padded + length; k += LANES) {
                    __global int_lanes *held = (__global int_lanes *)(key_u + tile + k);
                    int_lanes high = *held;
                    for (int t = 0; t < length; t++)
                        high = larger(high, *(__global int_lanes *)(keys + t * key_row + k - t));
                    *held = high;
                }
            }
            for (int k = 0; k < block + padded; k++) {
                int u = start + smallest + k;
                if (u < 0 || u >= width || key_u[k] <= mask) continue;
                __global int *held = other_out + y * width + column_at(u, width, direction);
                *held = key_u[k] > *held ? key_u[k] : *held;
            }
        }
    }
}
