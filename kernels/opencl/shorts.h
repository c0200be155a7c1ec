// Vectors of whole numbers of 16 bits, twice as many lanes as lanes.h has.
#define SHORTS (2 * LANES)
typedef short shorts __attribute__((ext_vector_type(SHORTS), aligned(2)));
typedef ushort ushorts __attribute__((ext_vector_type(SHORTS), aligned(2)));
typedef uchar bytes __attribute__((ext_vector_type(SHORTS), aligned(1)));
// 0, 1, 2 ... from the first lane on.
#if LANES == 16
#define NUMBERS(TYPE) (TYPE)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25, \
    26, 27, 28, 29, 30, 31)
#else
#define NUMBERS(TYPE) (TYPE)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15)
#endif

// The smallest lane.
inline __attribute__((always_inline)) int smallest_of(ushorts v)
{
#ifdef __SSE4_1__
#if LANES == 16
    ushort16 sixteen = v.lo < v.hi ? v.lo : v.hi;
#else
    ushort16 sixteen = v;
#endif
    ushort8 eight = sixteen.lo < sixteen.hi ? sixteen.lo : sixteen.hi;
    ushort8 found = __builtin_astype(__builtin_ia32_phminposuw128(__builtin_astype(eight, short8)), ushort8);
    return found[0];
#else
    // One by one, as Oclgrind takes a half of so many lanes for undefined, and compilers know what this means.
    ushort low = v[0];
    for (int k = 1; k < SHORTS; k++) low = v[k] < low ? v[k] : low;
    return low;
#endif
}
