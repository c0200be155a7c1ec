// Fill small holes along the row.
#define MASKED 16
#define FILLED 32

// Whether a column lies in the picture and the mask.
inline int usable(__global const uchar *validity, int row, int column, int width)
{
    return column >= 0 && column < width && validity[row + column] != MASKED;
}

// The disparity there, NaN outside of picture or mask.
inline float value_at(
    __global const float *disparity, __global const uchar *validity, int row, int column, int width)
{
    return usable(validity, row, column, width) ? disparity[row + column] : NAN;
}

// Whether a column belongs to a hole: usable, but without a value.
inline int empty(
    __global const float *disparity, __global const uchar *validity, int row, int column, int width)
{
    return usable(validity, row, column, width) && disparity[row + column] != disparity[row + column];
}

// Give a value to holes of at most reach pixels in a row; a filled pixel carries FILLED.
// Ends that agree to tolerance px are joined by a line; else the hole is background that the nearer surface
// hides from the other camera, and takes the smaller disparity. A hole that ends at the picture's or the
// mask's edge stays: nothing tells what is there.
__kernel void fill(
    // In:
    __global const float *disparity,
    __global const uchar *validity,
    int width,
    int height,
    int reach,
    float tolerance,
    // Out:
    __global float *disparity_out,
    __global uchar *validity_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    int pixel = y * width + x;
    disparity_out[pixel] = disparity[pixel];
    validity_out[pixel] = validity[pixel];
    if (disparity[pixel] == disparity[pixel] || validity[pixel] == MASKED) return;
    int row = y * width, left = 1, right = 1;
    while (left <= reach && empty(disparity, validity, row, x - left, width)) left++;
    while (right <= reach && empty(disparity, validity, row, x + right, width)) right++;
    if (left + right - 1 > reach) return;
    float before = value_at(disparity, validity, row, x - left, width);
    float after = value_at(disparity, validity, row, x + right, width);
    if (before != before || after != after) return;
    // Counted from the lower end, so that a mirrored picture rounds alike.
    float value = before < after ? before : after, rise = (before < after ? after : before) - value;
    if (rise <= tolerance) value += rise * ((float)(before < after ? left : right) / (float)(left + right));
    disparity_out[pixel] = value;
    validity_out[pixel] = FILLED;
}
