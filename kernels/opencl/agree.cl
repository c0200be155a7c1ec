// Left-right check of two maps: what a view sees, the other view must see too.
#define OCCLUDED 4
#define MISMATCH 8

// Take a disparity away where the other view's own map differs from it by more than tolerance px at the pixel that it
// points at. After Hirschmueller (PAMI 2008), section 2.5: a pixel is a mismatch if the other view sees a point
// somewhere on its ray, which is a whole disparity of the range to tolerance px, else it is occluded.
__kernel void agree(
    // In:
    __global const float *disparity,
    __global const uchar *validity,
    __global const float *other_disparity,
    int width,
    int height,
    int smallest,
    int disparities,
    int direction,
    float tolerance,
    // Out:
    __global float *disparity_out,
    __global uchar *validity_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    int pixel = y * width + x;
    float value = disparity[pixel];
    disparity_out[pixel] = value;
    validity_out[pixel] = validity[pixel];
    if (value != value) return;
    __global const float *row = other_disparity + y * width;
    int u = x + direction * floor_to_int(value + 0.5f);
    if (u >= 0 && u < width) {
        float difference = row[u] - value;
        if (difference <= tolerance && -difference <= tolerance) return;
    }
    int verdict = OCCLUDED;
    for (int d = smallest; d < smallest + disparities; d++) {
        u = x + direction * d;
        if (u < 0 || u >= width) continue;
        float difference = row[u] - (float)d;
        if (difference <= tolerance && -difference <= tolerance) {
            verdict = MISMATCH;
            break;
        }
    }
    disparity_out[pixel] = NAN;
    validity_out[pixel] = verdict;
}
