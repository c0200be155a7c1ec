// Correlation and winner takes all in one pass that never holds the volume: the form for CPUs.
//
// A work-item owns a strip of rows and takes it in blocks of BLOCK columns. Column sums of products run down
// the strip, box sums along the row; both lie with the disparities side by side, so every vector instruction
// works on LANES disparities of one pixel. Columns count in the direction in which the other view's match
// walks forward, which for the left view as reference is from the right edge to the left.
#include "peaks.h"

#define BLOCK 64
#define LANES 8
#define CHUNK 32
typedef float lanes __attribute__((ext_vector_type(LANES), aligned(4)));
typedef int int_lanes __attribute__((ext_vector_type(LANES), aligned(4)));

// The picture's column at walking position p.
inline int column_at(int p, int width, int direction) { return direction > 0 ? p : width - 1 - p; }

// Copy walking positions start .. start + length - 1 of a row, its edge repeated.
inline void load_row(
    __global const float *row, int start, int length, int width, int direction, __global float *row_out)
{
    for (int k = 0; k < length; k++)
        row_out[k] = row[column_at(clamp_index(start + k, width), width, direction)];
}

// The same, but 0 outside the picture: nothing correlates there.
inline void load_row_or_zero(
    __global const float *row, int start, int length, int width, int direction, __global float *row_out)
{
    for (int k = 0; k < length; k++) {
        int p = start + k;
        row_out[k] = p < 0 || p >= width ? 0.0f : row[column_at(p, width, direction)];
    }
}

inline float largest(lanes v)
{
    float result = v[0];
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
    int padded = (disparities + CHUNK - 1) / CHUNK * CHUNK;
    int columns = BLOCK + 2 * radius, span = columns + padded, window = 2 * radius + 1;
    float count = (float)(window * window);

    // Scratch of this strip; kernels/geometry.py computes the same size.
    __global float *sums = scratch + (long)strip * (padded * (columns + BLOCK) + 5 * span + 3 * columns + 2 * LANES);
    __global float *scores = sums + padded * columns + LANES; // a score on either side may be read, and is not used
    __global float *other_entering = scores + padded * BLOCK + LANES;
    __global float *other_leaving = other_entering + span;
    __global float *sum_u = other_leaving + span;
    __global float *inverse_u = sum_u + span;
    __global int *key_u = (__global int *)(inverse_u + span);
    __global float *entering = (__global float *)(key_u + span);
    __global float *leaving = entering + columns;
    __global float *mean_x = leaving + columns;

    for (int start = 0; start < width; start += BLOCK) {
        int block = start + BLOCK < width ? BLOCK : width - start;
        int used = block + 2 * radius;
        for (int k = 0; k < padded * columns; k++) sums[k] = 0.0f;

        for (int y = first - 2 * radius; y < last; y++) {
            __global const float *row_in = reference + clamp_index(y + radius, height) * width;
            __global const float *other_in = other + clamp_index(y + radius, height) * width;
            load_row(row_in, start - radius, used, width, direction, entering);
            load_row(other_in, start - radius + smallest, used + padded, width, direction, other_entering);
            if (y > first) {
                // The row that left the window when it moved down to y; before the first row nothing has.
                __global const float *row_out = reference + clamp_index(y - radius - 1, height) * width;
                __global const float *other_gone = other + clamp_index(y - radius - 1, height) * width;
                load_row(row_out, start - radius, used, width, direction, leaving);
                load_row(other_gone, start - radius + smallest, used + padded, width, direction, other_leaving);
            } else {
                for (int k = 0; k < used; k++) leaving[k] = 0.0f;
                for (int k = 0; k < used + padded; k++) other_leaving[k] = 0.0f;
            }
            if (y < first) {
                for (int c = 0; c < used; c++)
                    for (int i = 0; i < padded; i += LANES) {
                        __global lanes *sum = (__global lanes *)(sums + (i / CHUNK * columns + c) * CHUNK + i % CHUNK);
                        *sum = *sum + entering[c] * *(__global const lanes *)(other_entering + c + i);
                    }
                continue;
            }
            load_row_or_zero(other_sum + y * width, start + smallest, block + padded, width, direction, sum_u);
            load_row_or_zero(other_inverse + y * width, start + smallest, block + padded, width, direction, inverse_u);
            for (int k = 0; k < block + padded; k++) key_u[k] = 0;
            load_row(reference_sum + y * width, start, block, width, direction, mean_x);
            for (int k = 0; k < block; k++) mean_x[k] = mean_x[k] / count;

            for (int chunk = 0; chunk < padded; chunk += CHUNK) {
                __global float *sum = sums + chunk * columns;
                lanes box[CHUNK / LANES];
                for (int v = 0; v < CHUNK / LANES; v++) box[v] = (lanes)(0.0f);
                for (int c = 0; c < used; c++) {
                    float in = entering[c], out = leaving[c];
                    for (int v = 0; v < CHUNK / LANES; v++) {
                        int at = c + chunk + v * LANES;
                        __global lanes *column = (__global lanes *)(sum + c * CHUNK + v * LANES);
                        lanes products = *column + in * *(__global const lanes *)(other_entering + at)
                                         - out * *(__global const lanes *)(other_leaving + at);
                        *column = products;
                        box[v] += products;
                    }
                    int x = c - 2 * radius;
                    if (x < 0) continue;
                    float mean = mean_x[x];
                    float inverse = reference_inverse[y * width + column_at(start + x, width, direction)];
                    for (int v = 0; v < CHUNK / LANES; v++) {
                        int at = x + chunk + v * LANES;
                        // This order of operations is the same in every form of the correlation, so that all agree.
                        lanes score = ((box[v] - mean * *(__global const lanes *)(sum_u + at)) * inverse)
                                      * *(__global const lanes *)(inverse_u + at);
                        *(__global lanes *)(scores + x * padded + chunk + v * LANES) = score > 0.0f ? score : 0.0f;
                        box[v] -= *(__global const lanes *)(sum + x * CHUNK + v * LANES);
                    }
                }
            }

            for (int x = 0; x < block; x++) {
                __global float *score = scores + x * padded;
                for (int i = disparities; i < padded; i++) score[i] = 0.0f;
                lanes high = (lanes)(0.0f);
                for (int i = 0; i < padded; i += LANES) {
                    lanes s = *(__global const lanes *)(score + i);
                    high = s > high ? s : high;
                    lanes unit = s < 1.0f ? s : 1.0f;
                    int_lanes index = (int_lanes)(0, 1, 2, 3, 4, 5, 6, 7) + i;
                    int_lanes key = __builtin_convertvector(unit * 262143.0f, int_lanes) * 8192 + (8191 - index);
                    key = s > 0.0f ? key : 0;
                    __global int_lanes *held = (__global int_lanes *)(key_u + x + i);
                    *held = key > *held ? key : *held;
                }
                float best = largest(high);
                long pixel = (long)y * width + column_at(start + x, width, direction);
                score_out[pixel] = best;
                if (!(best > 0.0f)) {
                    disparity_out[pixel] = NAN;
                    ratio_out[pixel] = 0.0f;
                    validity_out[pixel] = validity[pixel] ? validity[pixel] : OUT_OF_RANGE;
                    continue;
                }
                int index = 0;
                while (score[index] != best) index++;
                lanes runner = (lanes)(0.0f);
                for (int i = 0; i < padded; i += LANES) {
                    lanes s = *(__global const lanes *)(score + i);
                    lanes before = *(__global const lanes *)(score + i - 1);
                    lanes after = *(__global const lanes *)(score + i + 1);
                    int_lanes at = (int_lanes)(0, 1, 2, 3, 4, 5, 6, 7) + i;
                    before = at == 0 ? 0.0f : before;
                    after = at == padded - 1 ? 0.0f : after;
                    lanes peak = s > before && s >= after && at != index ? s : 0.0f;
                    runner = peak > runner ? peak : runner;
                }
                float before = index > 0 ? score[index - 1] : 0.0f;
                float after = index < disparities - 1 ? score[index + 1] : 0.0f;
                disparity_out[pixel] = peak_disparity(index, best, before, after, smallest, subpixel);
                ratio_out[pixel] = largest(runner) / best;
                validity_out[pixel] = validity[pixel];
            }
            for (int k = 0; k < block + padded; k++) {
                int u = start + smallest + k;
                if (u < 0 || u >= width) continue;
                __global int *held = other_out + y * width + column_at(u, width, direction);
                *held = key_u[k] > *held ? key_u[k] : *held;
            }
        }
    }
}
