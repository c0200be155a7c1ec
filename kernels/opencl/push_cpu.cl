// Gaps of a picture filled from its next coarser level: the form for CPUs.
//
// A work-item owns a band of rows and takes eight texels at a time, each as one number.
#include "lanes.h"
#include "light.h"
typedef ulong eight __attribute__((ext_vector_type(8), aligned(8)));

// What push.cl computes.
__kernel void push(
    // In:
    __global const ushort *coarse,
    int coarse_width,
    int width,
    int height,
    // Out:
    __global ushort *fine_out)
{
    int2 rows = band_of_rows(height);
    for (int y = rows.x; y < rows.y; y++) {
        __global const ulong *from = (__global const ulong *)coarse + (long)(y / 2) * coarse_width;
        __global ulong *to = (__global ulong *)fine_out + (long)y * width;
        int x = 0;
        for (; x + 8 <= width; x += 8) {
            eight own = *(__global const eight *)(to + x);
            __global const ulong *c = from + x / 2;
            eight given = (eight)(c[0], c[0], c[1], c[1], c[2], c[2], c[3], c[3]);
            // The highest 16 bits are the fourth number.
            *(__global eight *)(to + x) = own >> 48 != 0 ? own : given;
        }
        for (; x < width; x++)
            if (to[x] >> 48 == 0) to[x] = from[x / 2];
    }
}
