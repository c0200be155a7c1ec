// Vectors of neighbouring pixels' channels, for the forms that are made for CPUs.
#define WIDE 16 // pixels side by side
typedef float wide __attribute__((ext_vector_type(WIDE), aligned(4)));
typedef int int_wide __attribute__((ext_vector_type(WIDE), aligned(4)));
typedef PIXEL pixels __attribute__((ext_vector_type(WIDE), aligned(1)));

// WIDE pixels from place i on, their channels apart: red is channel 0.
inline wide channel(__global const PIXEL *picture, long i, int channels, int which)
{
    if (channels == 1) return __builtin_convertvector(*(__global const pixels *)(picture + i), wide);
    __global const PIXEL *first = picture + i * 3;
    pixels a = *(__global const pixels *)first, b = *(__global const pixels *)(first + WIDE);
    pixels c = *(__global const pixels *)(first + 2 * WIDE), mixed;
    if (which == 0) {
        mixed = __builtin_shufflevector(a, b, 0, 3, 6, 9, 12, 15, 18, 21, 24, 27, 30, 0, 0, 0, 0, 0);
        mixed = __builtin_shufflevector(mixed, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 17, 20, 23, 26, 29);
    } else if (which == 1) {
        mixed = __builtin_shufflevector(a, b, 1, 4, 7, 10, 13, 16, 19, 22, 25, 28, 31, 0, 0, 0, 0, 0);
        mixed = __builtin_shufflevector(mixed, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 18, 21, 24, 27, 30);
    } else {
        mixed = __builtin_shufflevector(a, b, 2, 5, 8, 11, 14, 17, 20, 23, 26, 29, 0, 0, 0, 0, 0, 0);
        mixed = __builtin_shufflevector(mixed, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 16, 19, 22, 25, 28, 31);
    }
    return __builtin_convertvector(mixed, wide);
}
