// Which triangle each sample of a picture shows.
#include "triangle.h"

// Number of the nearest triangle at each sample, counted from 1, and the bits of its 1 / depth; both must come in as 0.
// screen is (N, 3): a vertex's column and row, px, sample centres at whole numbers, and 1 / depth, 0 where it is not to
// be drawn; faces is (M, 3). What lies on an edge belongs to both triangles; of equal depths the last triangle wins, so
// that a picture does not change from run to run. Stage 0 finds depths, stage 1 triangles: an atomic of 64 bits, which
// would do both, is not to be had everywhere. The bits of a positive number order as the number does.
__kernel void rasterise(
    // In:
    __global const float *screen,
    __global const int *faces,
    int triangles,
    int width,
    int height,
    int members,
    int stage,
    // Out:
    __global int *depth_out,
    __global int *owner_out)
{
    int member = get_global_id(0), face = get_global_id(1);
    if (member >= members || face >= triangles) return;
    Triangle t = load_triangle(screen, faces, face);
    if (!can_be_seen(t)) return;
    int left = first_sample(least(t.ax, t.bx, t.cx), 0, width), top = first_sample(least(t.ay, t.by, t.cy), 0, height);
    int columns = past_samples(most(t.ax, t.bx, t.cx), left, width) - left;
    int rows = past_samples(most(t.ay, t.by, t.cy), top, height) - top;
    // Members of a triangle share the samples of its box, neighbours side by side.
    for (int cell = member; cell < columns * rows; cell += members) {
        int x = left + cell % columns, y = top + cell / columns, at = y * width + x;
        Shares s = shares_at(t, (float)x, (float)y);
        if (!(s.a >= 0.0f && s.b >= 0.0f && s.c >= 0.0f)) continue;
        int near = as_int(s.a * t.az + s.b * t.bz + s.c * t.cz);
        if (stage == 0)
            atomic_max(depth_out + at, near);
        else if (depth_out[at] == near)
            atomic_max(owner_out + at, face + 1);
    }
}
