// Winner takes all over sums of paths: the form for GPUs.
//
// A work-group owns as many columns of a row as it has work-items. CLASSES work-items share the search of a pixel, each
// with every so many-th disparity, so that they read what lies together; then each work-item ends the search of its own
// column among what they found.
#include "lowest.h"
#define GROUP 64 // kernels/geometry.py has the same
#define CLASSES 8
#define PITCH (2 * CLASSES + 1) // keys of a column; columns begin in different banks
#define INDEX_BITS 15
#define NO_KEY 0x7fffffff

// Set each pixel's disparity (px), the lowest of its sums, and how that stands out: its ratio to the lowest one more than
// one disparity away. The first of equal sums wins. Where none is under UNMATCHED or validity tells a reason there is no
// disparity, the lowest sum is UNMATCHED, and the ratio 1.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void lowest(
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
    __local int keys[GROUP * PITCH];
    int lane = get_local_id(0), x0 = get_group_id(0) * GROUP, y = get_group_id(1), index = lane % CLASSES;
    for (int column = lane / CLASSES; column < GROUP && x0 + column < width; column += GROUP / CLASSES) {
        // Neighbouring disparities are in different classes, so that of the winner and its neighbours none hides the
        // lowest one elsewhere.
        __global const ushort *own = sums + ((long)y * width + x0 + column) * disparities;
        int low = NO_KEY, second = NO_KEY;
        for (int i = index; i < disparities; i += CLASSES) {
            int key = (int)own[i] << INDEX_BITS | i, higher = key < low ? low : key;
            second = higher < second ? higher : second;
            low = key < low ? key : low;
        }
        keys[column * PITCH + 2 * index] = low;
        keys[column * PITCH + 2 * index + 1] = second;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    if (x0 + lane >= width) return;
    __local const int *found = keys + lane * PITCH;
    long pixel = (long)y * width + x0 + lane;
    int winner = NO_KEY, runner = NO_KEY;
    for (int k = 0; k < 2 * CLASSES; k++) winner = found[k] < winner ? found[k] : winner;
    int best = winner >> INDEX_BITS, at = winner & ((1 << INDEX_BITS) - 1), known = validity[pixel];
    for (int k = 0; k < 2 * CLASSES; k++) {
        int away = (found[k] & ((1 << INDEX_BITS) - 1)) - at;
        if ((away < -1 || away > 1) && found[k] < runner) runner = found[k];
    }
    if (known || best >= UNMATCHED) {
        disparity_out[pixel] = NAN;
        lowest_out[pixel] = UNMATCHED;
        ratio_out[pixel] = 1.0f;
        validity_out[pixel] = known ? known : OUT_OF_RANGE;
        return;
    }
    __global const ushort *own = sums + pixel * disparities;
    int before = at > 0 ? own[at - 1] : UNMATCHED, after = at < disparities - 1 ? own[at + 1] : UNMATCHED;
    disparity_out[pixel] = lowest_disparity(at, best, before, after, smallest, subpixel);
    lowest_out[pixel] = best;
    ratio_out[pixel] = sums_ratio(best, runner >> INDEX_BITS);
    validity_out[pixel] = 0;
}
