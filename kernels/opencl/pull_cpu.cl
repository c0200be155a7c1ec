// The next coarser level of a picture with gaps: the form for CPUs.
//
// A work-item owns a band of rows. Nearly all squares lie inside of a chart or in a gap, and need no count.
#include "lanes.h"
#include "light.h"
#include "pull_texel.h"
typedef ushort two __attribute__((ext_vector_type(8), aligned(8)));
typedef uint two_sums __attribute__((ext_vector_type(8)));

// What pull.cl computes.
__kernel void pull(
    // In:
    __global const ushort *fine,
    int fine_width,
    int fine_height,
    int width,
    int height,
    // Out:
    __global ushort *coarse_out)
{
    int2 rows = band_of_rows(height);
    for (int y = rows.x; y < rows.y; y++) {
        __global const ushort *first = fine + (long)2 * y * fine_width * 4;
        for (int x = 0; x < width; x++) {
            if (2 * x + 1 >= fine_width || 2 * y + 1 >= fine_height) {
                pull_texel(fine, fine_width, fine_height, x, y, y * width + x, coarse_out);
                continue;
            }
            two above = *(__global const two *)(first + 8 * x);
            two below = *(__global const two *)(first + 8 * x + 4 * fine_width);
            if (above[3] && above[7] && below[3] && below[7]) {
                two_sums sums = __builtin_convertvector(above, two_sums) + __builtin_convertvector(below, two_sums);
                uint4 sum = (sums.lo + sums.hi + 2) / 4;
                put_texel(coarse_out, y * width + x, (ushort4)(sum.x, sum.y, sum.z, 65535));
            } else if (!(above[3] || above[7] || below[3] || below[7])) {
                put_texel(coarse_out, y * width + x, (ushort4)(0));
            } else {
                pull_texel(fine, fine_width, fine_height, x, y, y * width + x, coarse_out);
            }
        }
    }
}
