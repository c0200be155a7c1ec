// What both forms of fill know of a line, a row or a column, whose places are `stride` apart.
#define MASKED 16
#define FILLED 32

// The disparity with which a hole ends at place `at` of a line, NaN at the edge of picture or mask; the line goes on
// from there in steps of 1 or -1.
inline float end_of(
    __global const float *values, __global const uchar *why, int at, int step, long stride, int length, int near)
{
    if (at < 0 || at >= length || why[at * stride] & MASKED) return NAN;
    float value = values[at * stride];
    for (int i = 1; i < near; i++) {
        at += step;
        if (at < 0 || at >= length || why[at * stride] & MASKED) break;
        float next = values[at * stride];
        if (next == next) return next < value ? next : value;
    }
    return value;
}

// What a hole's pixel takes, so many steps from the hole's ends; NaN if nothing.
inline float between(float before, float after, int from_before, int from_after, int edges, float tolerance)
{
    if (before != before || after != after) return !edges ? NAN : before != before ? after : before;
    // Counted from the lower end, so that a mirrored picture rounds alike.
    int rising = before < after;
    float low = rising ? before : after, rise = (rising ? after : before) - low;
    float share = (float)(rising ? from_before : from_after) / (float)(from_before + from_after);
    return rise <= tolerance ? low + rise * share : low;
}
