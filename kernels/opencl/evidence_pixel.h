// What the two pictures say at one pixel about a disparity that is nearly right; needs likeness.h.
#define EVIDENCE_ENOUGH 3.0f // sum of weights; fewer samples tell nothing
#define UNKNOWN 1.0e6f       // residual variance where there is no evidence

// How much a sample weighs, by the guide's planes of `pixels` bytes each.
inline float sample_weight(__global const uchar *guide, int pixels, int here, int there)
{
    int difference = plane_difference(guide[here], guide[there]);
    difference += plane_difference(guide[here + pixels], guide[there + pixels]);
    difference += plane_difference(guide[here + 2 * pixels], guide[there + 2 * pixels]);
    return difference >= UNLIKE ? 0.0f : likeness(UNLIKE - difference);
}

// One pixel of evidence.cl.
inline void evidence_pixel(
    __global const float *reference, __global const float *other, __global const float *disparity,
    __global const float *along_x, __global const float *along_y, __global const uchar *guide, int x, int y, int width,
    int height, int radius, int stride, int direction, int weighted, float noise, float damping, float largest_step,
    float keep, __global float *moved_out, __global float *information_out, __global float *residual_out)
{
    int pixel = y * width + x;
    float value = disparity[pixel];
    moved_out[pixel] = value;
    information_out[pixel] = 0.0f;
    residual_out[pixel] = UNKNOWN;
    if (value != value || x % stride != 0 || y % stride != 0) return;
    float way = (float)direction, slope_x = along_x[pixel], slope_y = along_y[pixel];
    float n = 0.0f, sum_g = 0.0f, sum_e = 0.0f, sum_gg = 0.0f, sum_ge = 0.0f, sum_ee = 0.0f;
    for (int j = -radius; j <= radius; j++) {
        if (y + j < 0 || y + j >= height) continue;
        int row = (y + j) * width;
        float across_row = value + slope_y * (float)j;
        for (int i = -radius; i <= radius; i++) {
            int near = x + i;
            // Counted from x, so that a part of a picture rounds as the whole of it.
            float u = (float)i + way * (across_row + slope_x * (float)i);
            int left = floor_to_int(u), column = x + left;
            if (near < 1 || near > width - 2 || column < 1 || column > width - 3) continue;
            float share = u - (float)left, rest = 1.0f - share;
            __global const float *theirs = other + row + column, *ours = reference + row + near;
            float t0 = theirs[-1], t1 = theirs[0], t2 = theirs[1], t3 = theirs[2];
            float rise = 0.5f * ((t2 - t0) * rest + (t3 - t1) * share);
            float g = 0.5f * (rise + 0.5f * (ours[1] - ours[-1])), e = ours[0] - (t1 * rest + t2 * share);
            float weight = weighted ? sample_weight(guide, width * height, pixel, row + near) : 1.0f;
            float weighted_g = weight * g, weighted_e = weight * e;
            n += weight;
            sum_g += weighted_g;
            sum_e += weighted_e;
            sum_gg += weighted_g * g;
            sum_ge += weighted_g * e;
            sum_ee += weighted_e * e;
        }
    }
    if (!(n >= EVIDENCE_ENOUGH)) return;
    float gg = sum_gg - sum_g * sum_g / n, ge = sum_ge - sum_g * sum_e / n, ee = sum_ee - sum_e * sum_e / n;
    gg = gg > 0.0f ? gg : 0.0f; // rounding alone takes it below
    float step = way * ge / (gg + damping * noise);
    step = step > largest_step ? largest_step : (step < -largest_step ? -largest_step : step);
    float left_over = ee - 2.0f * way * step * ge + step * step * gg;
    float residual = (left_over > 0.0f ? left_over : 0.0f) / n, information = gg / (2.0f * noise + residual);
    float certain = information > 0.0f ? information / (information + keep) : 0.0f;
    moved_out[pixel] = value + step * certain;
    information_out[pixel] = information;
    residual_out[pixel] = residual;
}
