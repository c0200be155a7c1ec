// Sum and inverse norm of the window around every pixel, and which pixels can be matched at all: the form for CPUs.
//
// A work-item owns a strip of rows and takes it in blocks of columns. Column sums run down the strip; a prefix sum
// along the row gives every window by one difference, so that the cost does not depend on the window.
#include "lanes.h"
#define TEXTURELESS 2
#define MASKED 16
#define WIDEST (BLOCK + 31 + LANES) // columns under the windows of a block

// Sums of the lanes up to and with each one.
inline int_lanes prefix(int_lanes v)
{
    int_lanes none = (int_lanes)(0);
#if LANES == 16
    v += __builtin_shufflevector(none, v, 0, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 30);
    v += __builtin_shufflevector(none, v, 0, 0, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29);
    v += __builtin_shufflevector(none, v, 0, 0, 0, 0, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27);
    v += __builtin_shufflevector(none, v, 0, 0, 0, 0, 0, 0, 0, 0, 16, 17, 18, 19, 20, 21, 22, 23);
#else
    v += __builtin_shufflevector(none, v, 0, 8, 9, 10, 11, 12, 13, 14);
    v += __builtin_shufflevector(none, v, 0, 0, 8, 9, 10, 11, 12, 13);
    v += __builtin_shufflevector(none, v, 0, 0, 0, 0, 8, 9, 10, 11);
#endif
    return v;
}

// Sum I and 1 / ||I - mean|| over the window, the picture's edge repeated. The inverse norm is 0, so that nothing
// correlates, where the norm is at most threshold (grey levels, sqrt of the sum of squares) or the mask is 0.
__kernel void window_norms(
    // In:
    __global const float *picture,
    __global const uchar *mask,
    int width,
    int height,
    int radius,
    float threshold,
    int rows,
    // Out:
    __global float *sum_out,
    __global float *inverse_out,
    __global uchar *validity_out)
{
    int first = get_global_id(0) * rows, last = first + rows < height ? first + rows : height;
    int size = 2 * radius + 1;
    float count = (float)(size * size);
    // Whole numbers under 2^24, which floats hold exactly, and for the prefix sums under 2^31.
    float totals[WIDEST] ALIGNED, squares[WIDEST] ALIGNED, entering[WIDEST] ALIGNED, leaving[WIDEST] ALIGNED;
    int total_before[LANES + WIDEST] ALIGNED, square_before[LANES + WIDEST] ALIGNED;
    // The last lanes of a block may lie beyond its windows; what is computed there is not used.
    for (int k = 0; k < LANES + WIDEST; k++) total_before[k] = square_before[k] = 0;
    for (int start = 0; start < width; start += BLOCK) {
        int columns = start + BLOCK < width ? BLOCK : width - start, used = columns + 2 * radius;
        int inside = start >= radius && start - radius + used + LANES <= width;
        for (int k = 0; k < used; k += LANES) *(lanes *)(totals + k) = *(lanes *)(squares + k) = (lanes)(0.0f);
        for (int y = first - 2 * radius; y < last; y++) {
            // The row that enters the window of row y, and the one that left it; before the first row none has.
            __global const float *in_row = picture + (long)clamp_index(y + radius, height) * width + start - radius;
            __global const float *out_row =
                picture + (long)clamp_index(y - radius - 1, height) * width + start - radius;
            if (!inside) {
                load_line(entering, in_row - start + radius, start - radius, used, width, 1);
                load_line(leaving, out_row - start + radius, start - radius, used, width, 1);
            }
            int_lanes total_so_far = (int_lanes)(0), square_so_far = (int_lanes)(0);
            for (int k = 0; k < used; k += LANES) {
                lanes in = inside ? *(__global const lanes *)(in_row + k) : *(lanes *)(entering + k);
                lanes out = (lanes)(0.0f);
                if (y > first) out = inside ? *(__global const lanes *)(out_row + k) : *(lanes *)(leaving + k);
                lanes total = *(lanes *)(totals + k) + (in - out);
                lanes square = *(lanes *)(squares + k) + (in * in - out * out);
                *(lanes *)(totals + k) = total;
                *(lanes *)(squares + k) = square;
                if (y < first) continue;
                total_so_far += prefix(__builtin_convertvector(total, int_lanes));
                square_so_far += prefix(__builtin_convertvector(square, int_lanes));
                *(int_lanes *)(total_before + LANES + k) = total_so_far;
                *(int_lanes *)(square_before + LANES + k) = square_so_far;
                total_so_far = (int_lanes)(total_so_far[LANES - 1]);
                square_so_far = (int_lanes)(square_so_far[LANES - 1]);
            }
            if (y < first) continue;
            for (int k = 0; k < columns; k += LANES) {
                int *total_at = total_before + LANES - 1 + k, *square_at = square_before + LANES - 1 + k;
                lanes total = __builtin_convertvector(*(int_lanes *)(total_at + size) - *(int_lanes *)total_at, lanes);
                lanes square =
                    __builtin_convertvector(*(int_lanes *)(square_at + size) - *(int_lanes *)square_at, lanes);
                long pixel = (long)y * width + start + k;
                // Sums of whole numbers are exact; their product is not, but the difference of squares
                // loses little as the values are centred.
                lanes energy = square - total * (total / count);
                int_lanes flat = energy <= threshold * threshold;
                lanes inverse = flat ? (lanes)(0.0f) : 1.0f / sqrt(energy);
                if (k + LANES <= columns) {
                    int_lanes masked =
                        __builtin_convertvector(*(__global const uchar_lanes *)(mask + pixel), int_lanes) == 0;
                    int_lanes reason = masked ? (int_lanes)(MASKED) : flat ? (int_lanes)(TEXTURELESS) : (int_lanes)(0);
                    *(__global lanes *)(sum_out + pixel) = total;
                    *(__global lanes *)(inverse_out + pixel) = masked ? (lanes)(0.0f) : inverse;
                    *(__global uchar_lanes *)(validity_out + pixel) = __builtin_convertvector(reason, uchar_lanes);
                } else {
                    for (int j = 0; k + j < columns; j++) {
                        sum_out[pixel + j] = total[j];
                        inverse_out[pixel + j] = mask[pixel + j] ? inverse[j] : 0.0f;
                        validity_out[pixel + j] = !mask[pixel + j] ? MASKED : flat[j] ? TEXTURELESS : 0;
                    }
                }
            }
        }
    }
}
