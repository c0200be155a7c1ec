// Fill mismatched pixels with what a cross of like colour around them agrees on.
#include "vote_pixel.h"

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
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    int pixel = y * width + x;
    float value = disparity[pixel];
    int reason = validity[pixel];
    if (value != value && (reason & MISMATCH)) {
        value = elected(disparity, guide, x, y, width, height, reach, step, alike, least);
        if (value == value) reason |= FILLED;
    }
    disparity_out[pixel] = value;
    validity_out[pixel] = reason;
}
