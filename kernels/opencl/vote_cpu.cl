// Fill mismatched pixels with what a cross of like colour around them agrees on: the form for CPUs, whose work-items
// take a band of rows each.
#include "lanes.h"
#include "vote_pixel.h"
#define MANY 1024 // votes that are kept, so that the cross need not be walked twice

// What elected says, from one walk where there are not too many votes.
inline float elected_once(
    __global const float *disparity,
    __global const uchar *guide,
    int x,
    int y,
    int width,
    int height,
    int reach,
    int step,
    int alike,
    int least)
{
    float values[MANY + LANES];
    int wholes[MANY + LANES];
    int size = width * height, pixel = y * width + x, below = height - 1 - y, beside = width - 1 - x;
    int most_left = (reach < x ? reach : x) / step, most_right = (reach < beside ? reach : beside) / step;
    int up = arm(guide, size, pixel, -step * width, (reach < y ? reach : y) / step, alike);
    int down = arm(guide, size, pixel, step * width, (reach < below ? reach : below) / step, alike);
    int votes = 0, candidate = 0, lead = 0, backers = 0, sum = 0;
    for (int j = -up; j <= down; j++) {
        int middle = pixel + j * step * width;
        int left = arm(guide, size, middle, -step, most_left, alike);
        int right = arm(guide, size, middle, step, most_right, alike);
        if (votes + left + right + 1 > MANY)
            return elected(disparity, guide, x, y, width, height, reach, step, alike, least);
        for (int i = -left; i <= right; i++) {
            float value = disparity[middle + i * step];
            values[votes] = value;
            votes += value == value;
        }
    }
    if (votes < least) return NAN;
    for (int k = 0; k < votes; k += LANES) {
        lanes v = floor_lanes(*(lanes *)(values + k) + 0.5f);
        *(int_lanes *)(wholes + k) = __builtin_convertvector(v, int_lanes);
    }
    for (int k = 0; k < votes; k++) {
        candidate = lead == 0 ? wholes[k] : candidate;
        lead += wholes[k] == candidate ? 1 : -1;
    }
    for (int k = 0; k < votes; k++) {
        int agrees = wholes[k] == candidate;
        backers += agrees;
        sum += agrees ? floor_to_int(values[k] * PARTS + 0.5f) : 0;
    }
    return 2 * backers > votes ? (float)sum / (PARTS * (float)backers) : NAN;
}

// Give a mismatched pixel the disparity that most pixels of like colour around it have; it carries FILLED too then.
// Every step-th pixel of a vertical arm of at most reach px votes with every step-th one of its own horizontal arms.
// An arm ends where the guide, (3, H, W), differs by alike or more from where it began. The whole disparity of more
// than half of at least `least` votes wins.
// Source: Zhang, Lu and Lafruit, "Cross-based local stereo matching", TCSVT 2009; voting as in Mei et al., "On
// building an accurate stereo matching system on graphics hardware", GPUCV 2011, section 3.4.
__kernel void vote(
    // In:
    __global const float *disparity,
    __global const uchar *validity,
    __global const uchar *guide,
    int width,
    int height,
    int reach,
    int step,
    int alike,
    int least,
    // Out:
    __global float *disparity_out,
    __global uchar *validity_out)
{
    int2 band = band_of_rows(height);
    for (int y = band.x; y < band.y; y++) {
        long place = (long)y * width;
        for (int x = 0; x < width; x += LANES) {
            lanes values;
            load_line((float *)&values, disparity + place, x, 1, width, 1);
            int_lanes reasons = load_reasons(validity + place, x, width);
            store_lanes(disparity_out + place, x, width, values);
            store_reasons(validity_out + place, x, width, reasons);
            int asking = bits_of(values != values && (reasons & MISMATCH) != 0);
            for (; asking; asking &= asking - 1) {
                int at = x + __builtin_ctz(asking);
                float value = elected_once(disparity, guide, at, y, width, height, reach, step, alike, least);
                if (value != value) continue;
                disparity_out[place + at] = value;
                validity_out[place + at] |= FILLED;
            }
        }
    }
}
