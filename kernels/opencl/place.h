// Where a texel of a triangle lies in another picture; needs owner.h, weights.h and extremes.h.
typedef struct {
    float u, v;
} Place;

inline float within(float v, float low, float high)
{
    float above = v > low ? v : low;
    return above < high ? above : high;
}

// Place (u, v) that the centre of texel (x, y) shows; see place.cl.
inline Place find_place(__global const float *corners, int number, int x, int y, float margin)
{
    int face = face_of(number), inside = number > INSIDE;
    __global const float *at = corners + face * 15;
    Weights share = weights(corners, face, x, y);
    float a = share.a * (inside ? at[4] : 1.0f), b = share.b * (inside ? at[9] : 1.0f);
    float c = share.c * (inside ? at[14] : 1.0f);
    float sum = a + b + c;
    float u = (a * at[2] + b * at[7] + c * at[12]) / sum, v = (a * at[3] + b * at[8] + c * at[13]) / sum;
    Place result = {
        within(u, least(at[2], at[7], at[12]) - margin, most(at[2], at[7], at[12]) + margin),
        within(v, least(at[3], at[8], at[13]) - margin, most(at[3], at[8], at[13]) + margin)};
    return result;
}
