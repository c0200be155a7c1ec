// What a winner among sums of paths means.
#define OUT_OF_RANGE 1
#define UNMATCHED 60000 // sums from here on are no match
#define FAINT 100       // about what two places on a flat surface differ by

// The lowest sum's disparity in px, with a parabola through it and its neighbours where both match. before is higher.
inline float lowest_disparity(int index, int best, int before, int after, int smallest, int subpixel)
{
    float disparity = (float)(smallest + index);
    if (subpixel && before < UNMATCHED && after < UNMATCHED)
        disparity += 0.5f * (float)(before - after) / (float)((before - best) + (after - best));
    return disparity;
}

// How the winner stands out: its sum over the lowest one elsewhere, 1 where there is none. Both with FAINT added, since
// next to no cost is not better than none.
inline float sums_ratio(int best, int runner)
{
    return runner < UNMATCHED ? (float)(best + FAINT) / (float)(runner + FAINT) : 1.0f;
}
