// Barycentric weights of a texel's centre.
typedef struct {
    float a, b, c;
} Weights;

// Weights of the centre of texel (x, y) in a triangle; -1 where it has no area.
inline Weights weights(__global const float *corners, int face, int x, int y)
{
    __global const float *at = corners + face * 15;
    float ax = at[0], ay = at[1], bx = at[5], by = at[6], cx = at[10], cy = at[11];
    float area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
    Weights result = {-1.0f, -1.0f, -1.0f};
    if (area == 0.0f) return result;
    float px = (float)x + 0.5f, py = (float)y + 0.5f;
    result.a = ((bx - px) * (cy - py) - (by - py) * (cx - px)) / area;
    result.b = ((cx - px) * (ay - py) - (cy - py) * (ax - px)) / area;
    result.c = 1.0f - result.a - result.b;
    return result;
}
