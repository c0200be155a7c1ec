// Which triangle each sample of a picture shows: the form for CPUs.
//
// A work-item owns a band of rows of the picture and draws what every triangle has there, one after the other, in one
// stage. Every vector holds LANES samples of a row.
#include "lanes.h"
#include "triangle.h"

// Depths and numbers of LANES samples.
typedef struct {
    int_lanes depth, owner;
} Samples;

// Put in a triangle where it is not behind what is there; the same order of operations as in triangle.h.
inline Samples draw(Samples seen, Triangle t, float scale, int x, float ay, float by, float cy, int number)
{
    lanes px = __builtin_convertvector(lane_numbers() + x, lanes);
    lanes ax = t.ax - px, bx = t.bx - px, cx = t.cx - px;
    lanes a = (bx * cy - by * cx) * scale, b = (cx * ay - cy * ax) * scale, c = (ax * by - ay * bx) * scale;
    int_lanes depth = __builtin_astype(a * t.az + b * t.bz + c * t.cz, int_lanes);
    int_lanes wins = (a >= 0.0f & b >= 0.0f & c >= 0.0f) & (depth >= seen.depth);
    seen.depth = wins ? depth : seen.depth;
    seen.owner = wins ? number : seen.owner;
    return seen;
}

// What rasterise.cl computes; members and stage are not used.
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
    int2 band = band_of_rows(height);
    for (int face = 0; face < triangles; face++) {
        Triangle t = load_triangle(screen, faces, face);
        int top = first_sample(least(t.ay, t.by, t.cy), band.x, band.y);
        int bottom = past_samples(most(t.ay, t.by, t.cy), top, band.y);
        if (top >= bottom || !can_be_seen(t)) continue;
        int left = first_sample(least(t.ax, t.bx, t.cx), 0, width);
        int right = past_samples(most(t.ax, t.bx, t.cx), left, width);
        float scale = 1.0f / t.area;
        for (int y = top; y < bottom; y++) {
            __global int *depths = depth_out + (long)y * width, *owners = owner_out + (long)y * width;
            float row = (float)y, ay = t.ay - row, by = t.by - row, cy = t.cy - row;
            for (int x = left; x < right; x += LANES) {
                Samples seen;
                // What lies beyond the triangle is put back as it was.
                int start = x + LANES <= width ? x : width - LANES;
                if (start >= 0) {
                    seen.depth = *(__global const int_lanes *)(depths + start);
                    seen.owner = *(__global const int_lanes *)(owners + start);
                    seen = draw(seen, t, scale, start, ay, by, cy, face + 1);
                    *(__global int_lanes *)(depths + start) = seen.depth;
                    *(__global int_lanes *)(owners + start) = seen.owner;
                    continue;
                }
                seen.depth = seen.owner = 0;
                for (int k = 0; k < width; k++) {
                    seen.depth[k] = depths[k];
                    seen.owner[k] = owners[k];
                }
                seen = draw(seen, t, scale, 0, ay, by, cy, face + 1);
                for (int k = 0; k < width; k++) {
                    depths[k] = seen.depth[k];
                    owners[k] = seen.owner[k];
                }
            }
        }
    }
}
