// Vectors of neighbouring colours, for the forms that are made for CPUs; needs lanes.h.
#if LANES == 16
#define EACH(get, i) \
    (get(i[0]), get(i[1]), get(i[2]), get(i[3]), get(i[4]), get(i[5]), get(i[6]), get(i[7]), \
     get(i[8]), get(i[9]), get(i[10]), get(i[11]), get(i[12]), get(i[13]), get(i[14]), get(i[15]))
#define WITHOUT_FOURTHS THIRDS(0), THIRDS(16), THIRDS(32), THIRDS(48)
#else
#define EACH(get, i) (get(i[0]), get(i[1]), get(i[2]), get(i[3]), get(i[4]), get(i[5]), get(i[6]), get(i[7]))
#define WITHOUT_FOURTHS THIRDS(0), THIRDS(16)
#endif
#define THIRDS(i) i, i + 1, i + 2, i + 4, i + 5, i + 6, i + 8, i + 9, i + 10, i + 12, i + 13, i + 14

// A whole number that holds four channels: a pixel of three and the first one of the next.
#define JOINED(a, b) a##b
#define FOR_PIXEL(name, type) JOINED(name, type)
#define FOUR_uchar uint
#define FOUR_ushort ulong
typedef FOR_PIXEL(FOUR_, PIXEL) Four;
typedef Four LooseFour __attribute__((aligned(1)));
#define BITS (8 * (int)sizeof(PIXEL))
#define LARGEST ((1 << BITS) - 1)
typedef Four four_lanes __attribute__((ext_vector_type(LANES)));

// Levels of one channel, from its first bit on.
inline lanes levels(four_lanes four, int shift)
{
    return __builtin_convertvector(__builtin_convertvector(four >> shift, int_lanes) & LARGEST, lanes);
}
