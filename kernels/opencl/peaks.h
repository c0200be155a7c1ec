// The best and the second best peak of a row of scores, seen one score at a time.
#define OUT_OF_RANGE 1

// What is known after the scores so far; a peak is over its left neighbour and not under its right one.
typedef struct {
    float best;
    int index;
    float before, after, second, last, earlier;
} Peaks;

// Take in score number i; end a row with one more score, 0. Scores of 0 or less are no match.
inline void see(Peaks *peaks, float score, int i)
{
    float positive = score > 0.0f ? score : 0.0f;
    if (peaks->last > peaks->earlier && peaks->last >= positive) {
        if (peaks->last > peaks->best) {
            peaks->second = peaks->best;
            peaks->best = peaks->last;
            peaks->index = i - 1;
            peaks->before = peaks->earlier;
            peaks->after = positive;
        } else if (peaks->last > peaks->second) {
            peaks->second = peaks->last;
        }
    }
    peaks->earlier = peaks->last;
    peaks->last = positive;
}

// The best peak's disparity in px, with a parabola through it and its neighbours where both correlate.
inline float peak_disparity(int index, float best, float before, float after, int smallest, int subpixel)
{
    float disparity = (float)(smallest + index);
    if (subpixel && before > 0.0f && after > 0.0f) {
        float bend = (before - best) + (after - best);
        disparity += 0.5f * (before - after) / bend;
    }
    return disparity;
}

// Score in 18 bits above the disparity's index in 13, so that one max finds the other view's winner.
// Of equal scores the smaller disparity wins; 0 is no match.
inline int winner_key(float score, int i)
{
    float unit = score < 1.0f ? score : 1.0f;
    return score > 0.0f ? (int)(unit * 262143.0f) * 8192 + (8191 - i) : 0;
}
