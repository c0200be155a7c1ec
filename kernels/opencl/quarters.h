// Vectors of what lies in memory in fours, for the forms that are made for CPUs; needs lanes.h.
typedef float four __attribute__((ext_vector_type(4), aligned(4)));

// LANES places in memory, and there the first float, the second, the third and the fourth.
inline __attribute__((always_inline)) void load_fours(
    __global const float *from, int_lanes places, lanes *first, lanes *second, lanes *third, lanes *fourth)
{
    const int *place = (const int *)&places;
#ifdef __AVX2__
#define FOUR_AT(k) *(__global const four *)(from + place[k])
#if LANES == 16
#define QUARTER(k) (lanes)(FOUR_AT(k), FOUR_AT(k + 4), FOUR_AT(k + 8), FOUR_AT(k + 12))
#define QUARTERS(a, b, p, q, r, s) __builtin_shufflevector(a, b, p, q, r, s, \
    p + 4, q + 4, r + 4, s + 4, p + 8, q + 8, r + 8, s + 8, p + 12, q + 12, r + 12, s + 12)
#else
#define QUARTER(k) (lanes)(FOUR_AT(k), FOUR_AT(k + 4))
#define QUARTERS(a, b, p, q, r, s) __builtin_shufflevector(a, b, p, q, r, s, p + 4, q + 4, r + 4, s + 4)
#endif
    lanes p = QUARTER(0), q = QUARTER(1), r = QUARTER(2), s = QUARTER(3);
    lanes pq = QUARTERS(p, q, 0, LANES, 1, LANES + 1), rs = QUARTERS(r, s, 0, LANES, 1, LANES + 1);
    *first = QUARTERS(pq, rs, 0, 1, LANES, LANES + 1);
    *second = QUARTERS(pq, rs, 2, 3, LANES + 2, LANES + 3);
    pq = QUARTERS(p, q, 2, LANES + 2, 3, LANES + 3);
    rs = QUARTERS(r, s, 2, LANES + 2, 3, LANES + 3);
    *third = QUARTERS(pq, rs, 0, 1, LANES, LANES + 1);
    *fourth = QUARTERS(pq, rs, 2, 3, LANES + 2, LANES + 3);
#else
    for (int k = 0; k < LANES; k++) {
        (*first)[k] = from[place[k]];
        (*second)[k] = from[place[k] + 1];
        (*third)[k] = from[place[k] + 2];
        (*fourth)[k] = from[place[k] + 3];
    }
#endif
}
