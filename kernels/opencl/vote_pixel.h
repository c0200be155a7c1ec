// One pixel of vote: what the pixels of like colour around it agree on.
#define MISMATCH 8
#define FILLED 32
#define PARTS 16.0f // of a pixel, in which disparities are summed up: whole numbers, the same sum in any order

inline int apart(int a, int b) { return a < b ? b - a : a - b; }

// How many samples of a line, `by` places apart, follow a pixel until one differs from it by `alike` in a channel.
inline int arm(__global const uchar *guide, int size, int pixel, int by, int most, int alike)
{
    __global const uchar *red = guide + pixel, *green = red + size, *blue = green + size;
    int from_red = *red, from_green = *green, from_blue = *blue, samples = 0;
    for (int at = by; samples < most; at += by, samples++)
        if (apart(red[at], from_red) >= alike || apart(green[at], from_green) >= alike ||
            apart(blue[at], from_blue) >= alike)
            break;
    return samples;
}

// The mean of the whole disparity that more than half of the votes are for; NaN where there is none, or too few vote.
inline float elected(
    __global const float *disparity,
    __global const uchar *guide,
    int x,
    int y,
    int width,
    int height,
    int reach,
    int step,
    int alike,
    int least)
{
    int size = width * height, pixel = y * width + x, below = height - 1 - y, beside = width - 1 - x;
    int most_left = (reach < x ? reach : x) / step, most_right = (reach < beside ? reach : beside) / step;
    int up = arm(guide, size, pixel, -step * width, (reach < y ? reach : y) / step, alike);
    int down = arm(guide, size, pixel, step * width, (reach < below ? reach : below) / step, alike);
    int votes = 0, candidate = 0, lead = 0, backers = 0, sum = 0;
    // The one that may have a majority is found without counts of all: each vote against it takes one for it away.
    for (int counting = 0; counting < 2; counting++) {
        for (int j = -up; j <= down; j++) {
            int middle = pixel + j * step * width;
            int left = arm(guide, size, middle, -step, most_left, alike);
            int right = arm(guide, size, middle, step, most_right, alike);
            for (int i = -left; i <= right; i++) {
                float value = disparity[middle + i * step];
                if (value != value) continue;
                int whole = floor_to_int(value + 0.5f);
                if (counting) {
                    int agrees = whole == candidate;
                    backers += agrees;
                    sum += agrees ? floor_to_int(value * PARTS + 0.5f) : 0;
                } else {
                    votes++;
                    candidate = lead == 0 ? whole : candidate;
                    lead += whole == candidate ? 1 : -1;
                }
            }
        }
        if (votes < least || lead == 0) return NAN;
    }
    return 2 * backers > votes ? (float)sum / (PARTS * (float)backers) : NAN;
}
