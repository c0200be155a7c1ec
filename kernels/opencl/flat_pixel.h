// Planes between their centres, and how well a surface explains what both views show.
#define LEAST_WEIGHT 1e-4f // of a plane that nothing agrees with
#define WINDOW_REACH 2 // of the windows that are compared, px
#define WINDOW_SHARE 0.04f // one over their 25 pixels
#define WORSE 1.5f // how much more than the disparity given a plane may leave unexplained, in noise
#define MOST 16.0f // how much it may leave at all, in noise, where the other view sees it

// Of the two planes of a column next to a row: weights, and weighted sums of the value in that row at the column's
// centre, of slopes, and of shares.
typedef struct {
    float weight, value, along_x, along_y, share;
} Column;

// The number of the last centre that is not to the right of (below) a pixel, from -1 on. Centres lie pitch px apart,
// the first one in the middle of the first pitch pixels.
inline int centre_before(int x, int pitch) { return (2 * x + 1 + pitch) / (2 * pitch) - 1; }

// How far in half px a pixel lies from a centre.
inline int halves_from(int x, int centre, int pitch) { return 2 * x - (pitch - 1) - 2 * pitch * centre; }

// Weights are those of bilinear interpolation, in half px, times the cube of a plane's share.
inline __attribute__((always_inline)) Column column_at(
    __global const float *planes, int column, int y, int planes_wide, int planes_high, int pitch)
{
    int before = centre_before(y, pitch), past = halves_from(y, before, pitch), size = planes_wide * planes_high;
    Column sums = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
    for (int j = 0; j < 2; j++) {
        int row = clamp_index(before + j, planes_high);
        __global const float *plane = planes + row * planes_wide + clamp_index(column, planes_wide);
        if (plane[0] != plane[0]) continue;
        float share = plane[3 * size], weight = (float)(j ? past : 2 * pitch - past);
        weight *= share * share * share + LEAST_WEIGHT;
        sums.weight += weight;
        sums.value += weight * (plane[0] + plane[2 * size] * (0.5f * (float)halves_from(y, row, pitch)));
        sums.along_x += weight * plane[size];
        sums.along_y += weight * plane[2 * size];
        sums.share += weight * share;
    }
    return sums;
}

// Variance of what is left between the views over the window around a pixel, whose disparity changes by along_x and
// along_y px a pixel; edges repeated.
inline float unexplained(
    __global const float *reference, __global const float *other, int x, int y, int width, int height,
    float direction, float disparity, float along_x, float along_y)
{
    float sum = 0.0f, squares = 0.0f;
    for (int j = -WINDOW_REACH; j <= WINDOW_REACH; j++) {
        int row = clamp_index(y + j, height) * width;
        float surface = disparity + along_y * (float)j;
        for (int i = -WINDOW_REACH; i <= WINDOW_REACH; i++) {
            int column = clamp_index(x + i, width);
            // Apart from the column, so that a part of a picture rounds as the whole of it.
            float shift = direction * (surface + along_x * (float)i);
            int whole = floor_to_int(shift), u = column + whole;
            float share = shift - (float)whole;
            float seen = other[row + clamp_index(u, width)] * (1.0f - share);
            seen += other[row + clamp_index(u + 1, width)] * share;
            float left = reference[row + column] - seen;
            sum += left;
            squares += left * left;
        }
    }
    float mean = sum * WINDOW_SHARE, variance = squares * WINDOW_SHARE - mean * mean;
    return variance > 0.0f ? variance : 0.0f;
}
