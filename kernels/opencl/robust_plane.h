// A plane through the cells around it that are not led astray by those of other surfaces.
#define FITS 4            // the first one takes all cells alike, then those far off the plane weigh ever less
#define WIDEST_SCALE 4.0f // px: of the second fit; half of it with each further one (graduated non-convexity)
#define FIT_ENOUGH 1.0e-6f // sum of weights: less tells no plane
#define FIT_STIFF 0.25f   // pulls the slopes towards 0, in squared cells: cells on a line tell no slope across it
#define STEEPEST 1.0f     // slope, px a pixel

// One plane; see planes.cl. Sums take the rows one after another, each from left to right.
inline void fit_plane(
    __global const float *cells, int cells_wide, int cells_high, int planes_wide, int planes_high, int column, int row,
    int cell, int spacing, int reach, float tolerance, __global float *planes_out)
{
    long count = (long)cells_wide * cells_high, planes = (long)planes_wide * planes_high;
    int middle_x = column * spacing + spacing / 2, middle_y = row * spacing + spacing / 2;
    int left = middle_x > reach ? middle_x - reach : 0, top = middle_y > reach ? middle_y - reach : 0;
    int right = middle_x + reach < cells_wide ? middle_x + reach + 1 : cells_wide;
    int bottom = middle_y + reach < cells_high ? middle_y + reach + 1 : cells_high;
    int side = cell * spacing;
    float centre_x = (float)(column * side) + 0.5f * (float)(side - 1);
    float centre_y = (float)(row * side) + 0.5f * (float)(side - 1);
    float furthest = (float)(cell * reach), inverse = 1.0f / (furthest * furthest);
    float stiff = FIT_STIFF * (float)(cell * cell);
    float value = 0.0f, along_x = 0.0f, along_y = 0.0f, sharpness = 0.0f;
    int fits = 1;
    for (int round = 0; round < FITS && fits; round++) {
        float n = 0.0f, sum_x = 0.0f, sum_y = 0.0f, sum_v = 0.0f;
        float sum_xx = 0.0f, sum_xy = 0.0f, sum_yy = 0.0f, sum_xv = 0.0f, sum_yv = 0.0f;
        for (int y = top; y < bottom; y++) {
            for (int x = left; x < right; x++) {
                __global const float *at = cells + (long)y * cells_wide + x;
                if (!(at[0] > 0.0f)) continue;
                float dx = at[count] - centre_x, dy = at[2 * count] - centre_y, v = at[3 * count] - value;
                float near = 1.0f - (dx * dx + dy * dy) * inverse;
                if (!(near > 0.0f)) continue;
                float off = (v - along_x * dx - along_y * dy) * sharpness;
                float like = 1.0f / (1.0f + off * off);
                float weight = at[0] * (near * near * near) * (like * like);
                float weighted_x = weight * dx, weighted_y = weight * dy;
                n += weight;
                sum_x += weighted_x;
                sum_y += weighted_y;
                sum_v += weight * v;
                sum_xx += weighted_x * dx;
                sum_xy += weighted_x * dy;
                sum_yy += weighted_y * dy;
                sum_xv += weighted_x * v;
                sum_yv += weighted_y * v;
            }
        }
        fits = n > FIT_ENOUGH;
        float one = 1.0f / n, mean_x = sum_x * one, mean_y = sum_y * one;
        float xx = sum_xx - sum_x * mean_x + stiff * n, yy = sum_yy - sum_y * mean_y + stiff * n;
        float xy = sum_xy - sum_x * mean_y, xv = sum_xv - sum_v * mean_x, yv = sum_yv - sum_v * mean_y;
        float area = xx * yy - xy * xy;
        along_x = (xv * yy - yv * xy) / area;
        along_y = (yv * xx - xv * xy) / area;
        along_x = along_x < -STEEPEST ? -STEEPEST : along_x > STEEPEST ? STEEPEST : along_x;
        along_y = along_y < -STEEPEST ? -STEEPEST : along_y > STEEPEST ? STEEPEST : along_y;
        value += sum_v * one - along_x * mean_x - along_y * mean_y;
        sharpness = round ? 2.0f * sharpness : 1.0f / WIDEST_SCALE;
    }
    float whole = 0.0f, on_it = 0.0f;
    for (int y = top; y < bottom && fits; y++) {
        for (int x = left; x < right; x++) {
            __global const float *at = cells + (long)y * cells_wide + x;
            if (!(at[0] > 0.0f)) continue;
            float dx = at[count] - centre_x, dy = at[2 * count] - centre_y;
            float near = 1.0f - (dx * dx + dy * dy) * inverse;
            if (!(near > 0.0f)) continue;
            float off = at[3 * count] - value - along_x * dx - along_y * dy, weight = at[0] * (near * near * near);
            whole += weight;
            if (off <= tolerance && -off <= tolerance) on_it += weight;
        }
    }
    __global float *out = planes_out + (long)row * planes_wide + column;
    out[0] = fits ? value : NAN;
    out[planes] = fits ? along_x : 0.0f;
    out[2 * planes] = fits ? along_y : 0.0f;
    out[3 * planes] = fits ? on_it / whole : 0.0f;
}
