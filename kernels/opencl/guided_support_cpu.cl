// Drop disparities that those surroundings that look alike do not share: the form for CPUs, whose work-items take a
// band of rows each.
#include "lanes.h"
#include "likeness.h"
#include "guided_support_pixel.h"
#include "guide_lanes.h"

// Keep a value that at least share of the pixels around it (within reach, every step-th) have, to tolerance px.
// Pixels count by how much they look like the one in question in the guide, three planes of bytes; those without a
// value count a quarter, against it, and masked ones not at all.
// A surface may lean: the tolerance grows by slope px with each row or column of distance.
__kernel void guided_support(
    // In:
    __global const float *disparity,
    __global const uchar *validity,
    __global const uchar *guide,
    int width,
    int height,
    int reach,
    int step,
    float tolerance,
    float slope,
    float share,
    // Out:
    __global float *disparity_out,
    __global uchar *validity_out)
{
    int2 band = band_of_rows(height);
    int half_way = reach / step, margin = half_way * step;
    int lines_hold = margin <= MARGIN && 2 * half_way < MOST_ACROSS;
    Lines lines;
    for (int y = band.x; y < band.y; y++) {
        int above_us = y / step, below_us = (height - 1 - y) / step;
        int first = above_us < half_way ? -above_us : -half_way, last = below_us < half_way ? below_us : half_way;
        long place = (long)y * width;
        for (int start = 0; start < width; start += SPAN) {
            if (!lines_hold) {
                for (int x = start; x < width && x < start + SPAN; x++)
                    support_pixel(disparity, validity, guide, x, y, width, height, reach, step, tolerance, slope, share,
                                  disparity_out, validity_out);
                continue;
            }
            load_neighbours(&lines, disparity, validity, guide, start, y, width, height, first, last, step, margin);
            bytes a = *(bytes *)(lines.guide[-first][0] + margin), b = *(bytes *)(lines.guide[-first][1] + margin);
            bytes c = *(bytes *)(lines.guide[-first][2] + margin);
            lanes values[GROUP], total[GROUP], agreeing[GROUP];
            UNROLL for (int k = 0; k < GROUP; k++) {
                values[k] = *(lanes *)(lines.disparity[-first] + margin + k * LANES);
                total[k] = agreeing[k] = (lanes)(0.0f);
            }
            for (int j = first; j <= last; j++) {
                for (int i = -half_way; i <= half_way; i++) {
                    int at = margin + i * step;
                    float allowed = tolerance + slope * (float)furthest(i * step, j * step);
                    bytes like = alike(&lines, j - first, at, a, b, c);
                    const uchar_lanes *quarter = (const uchar_lanes *)&like;
                    UNROLL for (int k = 0; k < GROUP; k++) {
                        lanes weight = likenesses(quarter[k]);
                        lanes theirs = *(lanes *)(lines.disparity[j - first] + at + k * LANES);
                        total[k] += theirs == theirs ? weight : HOLE * weight;
                        agreeing[k] += magnitude(theirs - values[k]) <= allowed ? weight : 0.0f;
                    }
                }
            }
            UNROLL for (int k = 0; k < GROUP; k++) {
                int x = start + k * LANES;
                if (x >= width) continue;
                int_lanes reasons = load_reasons(validity + place, x, width);
                int_lanes alone = agreeing[k] < share * total[k] && values[k] == values[k] && (reasons & MASKED) == 0;
                store_lanes(disparity_out + place, x, width, alone ? (lanes)(NAN) : values[k]);
                store_reasons(validity_out + place, x, width, alone ? reasons | MISMATCH : reasons);
            }
        }
    }
}
