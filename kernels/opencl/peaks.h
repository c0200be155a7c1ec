// The best peak of a row of scores and how it stands out, seen one score at a time.
// Scores count in whole levels, so that one max of a packed key finds a winner, in either view and on any device.
#define OUT_OF_RANGE 1

// Bits that hold the index of a disparity; the 30 - index_bits above them hold the score's level.
inline int index_bits(int disparities)
{
    int bits = 7; // more levels than a float has would not come back whole
    while ((1 << bits) < disparities) bits++;
    return bits;
}

// Levels of a score of 1.
inline float score_scale(int bits) { return (float)(1 << (30 - bits)); }

// A score's level: at most 1 level of rounding, none over 23 bits; 0 or less is no match.
inline int score_level(float score, int bits) { return (int)(score * score_scale(bits)); }

// Level above index, so that one max finds the other view's winner; of equal levels the smaller disparity wins.
inline int winner_key(int level, int i, int bits) { return level * (1 << bits) + ((1 << bits) - 1 - i); }

// The index in a key; the key must not be 0, which says that there is no match.
inline int key_index(int key, int bits) { return ~key & ((1 << bits) - 1); }

// What is known after the levels so far: the best one, its place and neighbours, and the runner-up, which is the
// highest level more than one place away from it. earlier is the highest of all but the last one.
typedef struct {
    int best, index, before, after, runner, last, earlier;
} Peaks;

inline Peaks no_peaks(void)
{
    Peaks peaks = {0, -2, 0, 0, 0, 0, 0};
    return peaks;
}

// Take in level number i.
inline void see(Peaks *peaks, int level, int i)
{
    int positive = level > 0 ? level : 0;
    if (positive > peaks->best) {
        peaks->best = positive;
        peaks->index = i;
        peaks->before = peaks->last;
        peaks->after = 0;
        peaks->runner = peaks->earlier;
    } else if (i == peaks->index + 1) {
        peaks->after = positive;
    } else {
        peaks->runner = positive > peaks->runner ? positive : peaks->runner;
    }
    peaks->earlier = peaks->last > peaks->earlier ? peaks->last : peaks->earlier;
    peaks->last = positive;
}

// The best level's disparity in px, with a parabola through it and its neighbours where both correlate.
inline float peak_disparity(int index, int best, int before, int after, int smallest, int subpixel)
{
    float disparity = (float)(smallest + index);
    if (subpixel && before > 0 && after > 0)
        disparity += 0.5f * (float)(before - after) / (float)((before - best) + (after - best));
    return disparity;
}
