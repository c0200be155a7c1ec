// Of two disparity maps, the one whose surroundings cost less: the form for CPUs, whose work-items take a band of rows
// each. Sums of columns run down the band, and those of a few columns side by side are a window's.
#include "lanes.h"
#define WIDEST 32 // largest radius

// Add what a row says to the sums of columns from to to - 1, or take it away again; place k of the sums is column
// start + k.
inline void take_row(
    float *gains,
    float *counts,
    __global const float *disparity,
    __global const float *lowest,
    __global const float *rival_disparity,
    __global const float *rival_lowest,
    int start,
    int from,
    int to,
    float sign)
{
    int x = from;
    for (; x + LANES <= to; x += LANES) {
        lanes ours = *(__global const lanes *)(disparity + x), theirs = *(__global const lanes *)(rival_disparity + x);
        lanes gain = *(__global const lanes *)(lowest + x) - *(__global const lanes *)(rival_lowest + x);
        int_lanes both = ours == ours && theirs == theirs;
        *(lanes *)(gains + x - start) += both ? sign * gain : (lanes)(0.0f);
        *(lanes *)(counts + x - start) += both ? (lanes)(sign) : (lanes)(0.0f);
    }
    for (; x < to; x++) {
        if (disparity[x] != disparity[x] || rival_disparity[x] != rival_disparity[x]) continue;
        gains[x - start] += sign * (lowest[x] - rival_lowest[x]);
        counts[x - start] += sign;
    }
}

// Take the rival where over the (2 radius + 1)^2 pixels around, without those where either map has no value or that
// lie outside of the picture, the mean of lowest - rival_lowest exceeds margin. Where one map has no value, the other
// is taken. lowest and rival_lowest are whole numbers, whose sums are exact in any order below 2^24.
__kernel void merge(
    // In:
    __global const float *disparity,
    __global const float *lowest,
    __global const uchar *validity,
    __global const float *ratio,
    __global const float *rival_disparity,
    __global const float *rival_lowest,
    __global const uchar *rival_validity,
    __global const float *rival_ratio,
    int width,
    int height,
    int radius,
    float margin,
    // Out:
    __global float *disparity_out,
    __global float *lowest_out,
    __global uchar *validity_out,
    __global float *ratio_out)
{
    int2 band = band_of_rows(height);
    float gains[BLOCK + 2 * WIDEST + LANES] ALIGNED, counts[BLOCK + 2 * WIDEST + LANES] ALIGNED;
    for (int left = 0; left < width; left += BLOCK) {
        int columns = left + BLOCK < width ? BLOCK : width - left, start = left - radius;
        int from = start > 0 ? start : 0, to = left + columns + radius < width ? left + columns + radius : width;
        for (int k = 0; k < columns + 2 * radius + LANES; k += LANES) {
            *(lanes *)(gains + k) = (lanes)(0.0f);
            *(lanes *)(counts + k) = (lanes)(0.0f);
        }
        for (int y = band.x - 2 * radius; y < band.y; y++) {
            // The row that enters the window of row y, and the one that leaves it.
            int enters = y + radius, leaves = y - radius - 1;
            if (enters >= 0 && enters < height) {
                long row = (long)enters * width;
                take_row(gains, counts, disparity + row, lowest + row, rival_disparity + row, rival_lowest + row, start,
                         from, to, 1.0f);
            }
            if (y < band.x) continue;
            // Rows above the band's first window never came in.
            if (leaves >= 0 && leaves >= band.x - radius) {
                long row = (long)leaves * width;
                take_row(gains, counts, disparity + row, lowest + row, rival_disparity + row, rival_lowest + row, start,
                         from, to, -1.0f);
            }
            long place = (long)y * width;
            for (int k = 0; k < columns; k += LANES) {
                lanes gain = *(lanes *)(gains + k), count = *(lanes *)(counts + k);
                for (int i = 1; i <= 2 * radius; i++) {
                    gain += *(lanes *)(gains + k + i);
                    count += *(lanes *)(counts + k + i);
                }
                int x = left + k;
                int_lanes better = gain > margin * count;
                if (x + LANES <= width) {
                    lanes ours = *(__global const lanes *)(disparity + place + x);
                    lanes theirs = *(__global const lanes *)(rival_disparity + place + x);
                    int_lanes rival = theirs == theirs && (better || ours != ours);
                    *(__global lanes *)(disparity_out + place + x) = rival ? theirs : ours;
                    *(__global lanes *)(lowest_out + place + x) =
                        rival ? *(__global const lanes *)(rival_lowest + place + x)
                              : *(__global const lanes *)(lowest + place + x);
                    *(__global lanes *)(ratio_out + place + x) =
                        rival ? *(__global const lanes *)(rival_ratio + place + x)
                              : *(__global const lanes *)(ratio + place + x);
                    int_lanes reasons = load_reasons(validity + place, x, width);
                    int_lanes rival_reasons = load_reasons(rival_validity + place, x, width);
                    store_reasons(validity_out + place, x, width, rival ? rival_reasons : reasons);
                    continue;
                }
                for (int j = 0; x + j < width; j++) {
                    long pixel = place + x + j;
                    int has = disparity[pixel] == disparity[pixel];
                    int rival = rival_disparity[pixel] == rival_disparity[pixel] && (better[j] || !has);
                    disparity_out[pixel] = rival ? rival_disparity[pixel] : disparity[pixel];
                    lowest_out[pixel] = rival ? rival_lowest[pixel] : lowest[pixel];
                    validity_out[pixel] = rival ? rival_validity[pixel] : validity[pixel];
                    ratio_out[pixel] = rival ? rival_ratio[pixel] : ratio[pixel];
                }
            }
        }
    }
}
