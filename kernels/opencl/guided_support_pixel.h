// Whether the surroundings of a pixel share its disparity; needs likeness.h.
#define MISMATCH 8
#define HOLE 0.25f // of the weight of a neighbour without a value counts against


// Judge one pixel; see guided_support.cl.
inline void support_pixel(
    __global const float *disparity, __global const uchar *validity, __global const uchar *guide, int x, int y,
    int width, int height, int reach, int step, float tolerance, float slope, float share,
    __global float *disparity_out, __global uchar *validity_out)
{
    int pixel = y * width + x, half_way = reach / step;
    float value = disparity[pixel], total = 0.0f, agreeing = 0.0f;
    uchar reason = validity[pixel];
    disparity_out[pixel] = value;
    validity_out[pixel] = reason;
    if (value != value || (reason & MASKED)) return;
    for (int j = -half_way; j <= half_way; j++) {
        int dy = j * step, row = y + dy;
        if (row < 0 || row >= height) continue;
        for (int i = -half_way; i <= half_way; i++) {
            int dx = i * step, column = x + dx;
            if (column < 0 || column >= width) continue;
            float weight = neighbour_weight(guide, validity, width * height, pixel, row * width + column);
            float theirs = disparity[row * width + column], difference = theirs - value;
            float allowed = tolerance + slope * (float)furthest(dx, dy);
            total += theirs == theirs ? weight : HOLE * weight;
            agreeing += difference <= allowed && -difference <= allowed ? weight : 0.0f;
        }
    }
    if (agreeing < share * total) {
        disparity_out[pixel] = NAN;
        validity_out[pixel] = reason | MISMATCH;
    }
}
