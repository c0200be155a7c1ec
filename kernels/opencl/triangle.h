// Where a sample lies in a triangle of a picture.

// A triangle's corners: their places in the picture, px, and 1 / depth; and twice its area, px^2, below 0 where its
// corners run counter-clockwise as seen, as those of a face do that is seen from the front.
typedef struct {
    float ax, ay, az, bx, by, bz, cx, cy, cz, area;
} Triangle;

// Shares of the three corners, in the picture.
typedef struct {
    float a, b, c;
} Shares;

inline Triangle load_triangle(__global const float *screen, __global const int *faces, int face)
{
    __global const float *a = screen + (long)faces[face * 3L] * 3;
    __global const float *b = screen + (long)faces[face * 3L + 1] * 3;
    __global const float *c = screen + (long)faces[face * 3L + 2] * 3;
    Triangle t = {a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2], 0.0f};
    t.area = (t.bx - t.ax) * (t.cy - t.ay) - (t.by - t.ay) * (t.cx - t.ax);
    return t;
}

// Whether it can be seen: no corner is behind the camera, and it is not seen edge on.
inline int can_be_seen(Triangle t)
{
    return t.az > 0.0f && t.bz > 0.0f && t.cz > 0.0f && (t.area > 0.0f || t.area < 0.0f);
}

// An edge is tested by the same products for both of its triangles, so that their shares of it differ in sign alone and
// no crack can open between them.
inline Shares shares_at(Triangle t, float x, float y)
{
    float ax = t.ax - x, ay = t.ay - y, bx = t.bx - x, by = t.by - y, cx = t.cx - x, cy = t.cy - y;
    float scale = 1.0f / t.area;
    Shares s = {(bx * cy - by * cx) * scale, (cx * ay - cy * ax) * scale, (ax * by - ay * bx) * scale};
    return s;
}

inline float least(float a, float b, float c) { return a < b ? (a < c ? a : c) : (b < c ? b : c); }
inline float most(float a, float b, float c) { return a > b ? (a > c ? a : c) : (b > c ? b : c); }

// The first whole number that is not below v, between low and high.
inline int first_sample(float v, int low, int high)
{
    return v > (float)low ? (v < (float)high ? -floor_to_int(-v) : high) : low;
}

// One past the last whole number that is not above v, between low and high.
inline int past_samples(float v, int low, int high)
{
    return v >= (float)low ? (v < (float)high ? floor_to_int(v) + 1 : high) : low;
}
