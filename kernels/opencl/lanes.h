// Vectors of neighbouring pixels, for the forms that are made for CPUs.
#ifdef __AVX512BW__
#define LANES 16
#else
#define LANES 8
#endif
// Put before a short loop over private vectors, which then stay in registers; PoCL leaves loops as they are.
#define UNROLL _Pragma("unroll")
// Columns that a work-item takes at a time: mostly whole rows, since memory is read fastest from end to end.
#define BLOCK (160 * LANES)
typedef float lanes __attribute__((ext_vector_type(LANES), aligned(4)));
typedef int int_lanes __attribute__((ext_vector_type(LANES), aligned(4)));
// For private arrays, whose whole vectors then lie in one line of the cache each.
#define ALIGNED __attribute__((aligned(4 * LANES)))
typedef char char_lanes __attribute__((ext_vector_type(LANES)));
typedef uchar uchar_lanes __attribute__((ext_vector_type(LANES), aligned(1)));

// 0, 1, 2 ... from the first lane on.
inline int_lanes lane_numbers(void)
{
#if LANES == 16
    return (int_lanes)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
#else
    return (int_lanes)(0, 1, 2, 3, 4, 5, 6, 7);
#endif
}

// Rows first to last - 1 are this work-item's: an even share of the picture for each.
inline int2 band_of_rows(int height)
{
    int rows = (height - 1) / (int)get_global_size(0) + 1, first = (int)get_global_id(0) * rows;
    return (int2)(first, first + rows < height ? first + rows : height);
}

// Columns from p on of a row, as many as asked for and up to a whole vector; outside of the picture NaN, or its
// edge repeated.
inline void load_line(float *line, __global const float *row, int p, int columns, int width, int repeat)
{
    if (p >= 0 && p + columns + LANES <= width) {
        for (int k = 0; k < columns; k += LANES) *(lanes *)(line + k) = *(__global const lanes *)(row + p + k);
        return;
    }
    for (int k = 0; k < columns; k += LANES) {
        if (p + k >= 0 && p + k + LANES <= width) {
            *(lanes *)(line + k) = *(__global const lanes *)(row + p + k);
            continue;
        }
        for (int j = k; j < k + LANES; j++) {
            int inside = clamp_index(p + j, width);
            line[j] = repeat || p + j == inside ? row[inside] : NAN;
        }
    }
}

// Write the columns from x on that lie in the picture.
inline void store_lanes(__global float *row, int x, int width, lanes value)
{
    if (x + LANES <= width) {
        *(__global lanes *)(row + x) = value;
    } else {
        for (int j = 0; x + j < width; j++) row[x + j] = value[j];
    }
}

// The largest whole numbers that are not above the lanes. (The built-in floor would be a call.)
inline lanes floor_lanes(lanes v)
{
    lanes whole = __builtin_convertvector(__builtin_convertvector(v, int_lanes), lanes);
    return v < whole ? whole - 1.0f : whole;
}

// Why pixels from column x on have no value, for as many lanes as lie in the picture.
inline int_lanes load_reasons(__global const uchar *row, int x, int width)
{
    if (x + LANES <= width) return __builtin_convertvector(*(__global const uchar_lanes *)(row + x), int_lanes);
    int_lanes reasons = (int_lanes)(0);
    for (int j = 0; x + j < width; j++) reasons[j] = row[x + j];
    return reasons;
}

inline void store_reasons(__global uchar *row, int x, int width, int_lanes reasons)
{
    if (x + LANES <= width) {
        *(__global uchar_lanes *)(row + x) = __builtin_convertvector(reasons, uchar_lanes);
    } else {
        for (int j = 0; x + j < width; j++) row[x + j] = reasons[j];
    }
}

// The lanes without their signs.
inline lanes magnitude(lanes v) { return __builtin_astype(__builtin_astype(v, int_lanes) & 0x7fffffff, lanes); }

// One bit a lane of a comparison that holds, the first lane's lowest.
inline int bits_of(int_lanes holds)
{
#if LANES == 16
    int_lanes bits = {1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, 32768};
    int8 some = (holds & bits).lo | (holds & bits).hi;
#else
    int_lanes bits = {1, 2, 4, 8, 16, 32, 64, 128};
    int8 some = holds & bits;
#endif
    int4 few = some.lo | some.hi;
    int2 two = few.lo | few.hi;
    return two.x | two.y;
}

// Whether any lane of a comparison holds.
inline int any_lane(int_lanes holds)
{
    char_lanes narrow = __builtin_convertvector(holds, char_lanes);
#if LANES == 16
    ulong2 halves = __builtin_astype(narrow, ulong2);
    return (halves.x | halves.y) != 0;
#else
    return __builtin_astype(narrow, ulong) != 0;
#endif
}
