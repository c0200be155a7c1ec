// How far a disparity map lies from a right triangle of its lattice.

inline int jumps(float a, float b, float most)
{
    return !(a - b <= most && b - a <= most);  // also where one has no value
}

inline int is_inside(int x, int y, int width, int height)
{
    return x >= 0 && y >= 0 && x < width && y < height;
}

// Whether a row of pixels lies more than error_px from a line: from `at` on, each `step` places further.
inline int strays(__global const float *disparity, int at, int step, int length, float value, float rise, float error_px)
{
    int found = 0;
    // To the end of the row, so that loads do not wait for each other: on a GPU that is twice as fast.
    for (int i = 0; i <= length; i++) {
        float off = disparity[at + i * step] - (value + (float)i * rise);
        found |= !(off <= error_px && -off <= error_px);
    }
    return found;
}

// Whether the triangle with the middle (x, y) of its hypotenuse must be split; see split_triangles.cl.
inline int must_split(
    __global const float *disparity, __global const float *corners, __global const uchar *split, int x, int y,
    int along_x, int along_y, int away_x, int away_y, int width, int height, int side, int diagonal, float error_px,
    float max_jump_px)
{
    int half_side = side / 2;
    int px = x + along_x, py = y + along_y, qx = x - along_x, qy = y - along_y, ax = x + away_x, ay = y + away_y;
    if (!(is_inside(px, py, width, height) && is_inside(qx, qy, width, height) && is_inside(ax, ay, width, height))) {
        // Nothing of the picture is lost with a triangle that lies wholly outside, with at most a side on its edge.
        int out_x = px < qx ? px : qx, out_y = py < qy ? py : qy;
        out_x = ax < out_x ? ax : out_x;
        out_y = ay < out_y ? ay : out_y;
        int end_x = px > qx ? px : qx, end_y = py > qy ? py : qy;
        end_x = ax > end_x ? ax : end_x;
        end_y = ay > end_y ? ay : end_y;
        return out_x < width - 1 && out_y < height - 1 && end_x > 0 && end_y > 0;
    }
    int p = py * width + px, q = qy * width + qx, a = ay * width + ax;
    if (side == 2 && !diagonal) {
        float middle = disparity[y * width + x], at_p = disparity[p], at_q = disparity[q], at_a = disparity[a];
        if (jumps(middle, at_p, max_jump_px) || jumps(middle, at_q, max_jump_px) || jumps(middle, at_a, max_jump_px) ||
            jumps(at_a, at_p, max_jump_px) || jumps(at_a, at_q, max_jump_px)) return 1;
    } else {
        if (split[(ay + py) / 2 * width + (ax + px) / 2] || split[(ay + qy) / 2 * width + (ax + qx) / 2]) return 1;
    }
    // Rows from the right angle's corner along one leg, or from the hypotenuse to the corner, each shorter by `less`.
    int start = diagonal ? a : p, step, down, less;
    float value = corners[start], rise, drop, one = 1.0f / (float)side;
    if (diagonal) {
        step = (p - a) / side;
        down = (q - a) / side;
        less = 1;
        rise = (corners[p] - value) * one;
        drop = (corners[q] - value) * one;
    } else {
        step = (q - p) / side;
        down = step + (a - y * width - x) / half_side;
        less = 2;
        rise = (corners[q] - value) * one;
        drop = rise + (corners[a] - 0.5f * (value + corners[q])) * (2.0f * one);
    }
    for (int row = 0, length = side; length >= 0; row++, length -= less) {
        float first = value + (float)row * drop;
        if (strays(disparity, start + row * down, step, length, first, rise, error_px)) return 1;
    }
    return 0;
}
