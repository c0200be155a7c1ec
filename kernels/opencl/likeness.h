// How much two pixels look alike: weights of neighbours that probably belong to the same surface.
#define MASKED 16
#define UNLIKE 240 // difference of the guide, summed over its three planes, from which on neighbours do not count

// (1 - difference / UNLIKE)^8, close to exp(-difference / 30), given UNLIKE - difference; the same bits everywhere.
inline float likeness(int alike)
{
    float t = (float)alike * (1.0f / UNLIKE), t2 = t * t, t4 = t2 * t2;
    return t4 * t4;
}

inline int plane_difference(int a, int b) { return a > b ? a - b : b - a; }

// Weight of the neighbour `there` of the pixel `here`, by the guide's planes of `pixels` bytes each; 0 where masked.
inline float neighbour_weight(
    __global const uchar *guide, __global const uchar *validity, int pixels, int here, int there)
{
    int difference = plane_difference(guide[here], guide[there]);
    difference += plane_difference(guide[here + pixels], guide[there + pixels]);
    difference += plane_difference(guide[here + 2 * pixels], guide[there + 2 * pixels]);
    return difference >= UNLIKE || (validity[there] & MASKED) ? 0.0f : likeness(UNLIKE - difference);
}

// Rows or columns that a neighbour is away, whichever is more.
inline int furthest(int dx, int dy)
{
    int across = dx < 0 ? -dx : dx, down = dy < 0 ? -dy : dy;
    return across > down ? across : down;
}
