// Semi-global aggregation along the lines of one heading: the form for CPUs.
//
// What bounds it is memory, so that every volume passes once a launch. Along the rows (heading 0) a work-item walks
// its row from both ends at a time, while the row's costs and sums lie in the cache: two chains of results that do not
// wait for each other. Down or up the picture the three paths are walked together, BAND rows a stage. A work-item owns a
// strip of columns and begins the leaning paths as many columns outside of it as rows are left, so that strips need
// nothing of each other within a stage. What passes from a stage to the next are the paths of the band's last row.
//
// Every vector holds SHORTS disparities of one pixel; its neighbours one disparity away are shifted together from
// vectors that lie as they were stored, since a processor cannot take a vector from two stores that are under way.
#include "lanes.h"
#include "shorts.h"
#define NO_MATCH 255
#define UNSEEN_COST 96
#define UNMATCHED 60000
#define BAND 32 // rows of a stage; kernels/geometry.py computes the same,
#define WIDEST 256 // columns of a strip, and this
#define WALL 8000
#define PIXELS_AHEAD 16 // that are asked for beforehand along a row
#define INLINE inline __attribute__((always_inline))
#if SHORTS == 32
#define SHIFT(a, b, n) __builtin_shufflevector(a, b, n, n + 1, n + 2, n + 3, n + 4, n + 5, n + 6, n + 7, \
    n + 8, n + 9, n + 10, n + 11, n + 12, n + 13, n + 14, n + 15, n + 16, n + 17, n + 18, n + 19, n + 20, n + 21, \
    n + 22, n + 23, n + 24, n + 25, n + 26, n + 27, n + 28, n + 29, n + 30, n + 31)
#else
#define SHIFT(a, b, n) __builtin_shufflevector(a, b, n, n + 1, n + 2, n + 3, n + 4, n + 5, n + 6, n + 7, \
    n + 8, n + 9, n + 10, n + 11, n + 12, n + 13, n + 14, n + 15)
#endif

// What becomes of the sums.
#define LEAVE 0
#define SET 1 // to the path
#define ADD 2
#define FINISH 3 // ADD, but UNMATCHED where there is no match

// One path at a pixel, the same for all of its disparities.
typedef struct {
    __global const short *from; // L of the pixel before
    __global short *to; // and of this one, maybe in the same place
    __global const short *walled; // L of the pixel before with walls on either side, where it is shifted by much
    short small, jump, cheapest;
} Path;

INLINE shorts least(shorts a, shorts b) { return a < b ? a : b; }

// Costs of disparities i and on, of which there may be less than SHORTS; room tells how many may be read.
INLINE shorts load_costs(__global const uchar *own, int room)
{
    bytes paid = 0;
    if (room >= SHORTS) {
        paid = *(__global const bytes *)own;
    } else {
        for (int k = 0; k < room; k++) paid[k] = own[k];
    }
    return __builtin_convertvector(paid, shorts);
}

// L of SHORTS disparities from i on. before and here are the vectors of the pixel before that lie one before and at i.
INLINE shorts arrive(Path path, shorts paid, shorts before, shorts here, shorts after, int i, int shift)
{
    shorts back, same, ahead;
    if (shift == 0) {
        back = SHIFT(before, here, SHORTS - 1);
        same = here;
        ahead = SHIFT(here, after, 1);
    } else if (shift == 1) {
        back = SHIFT(before, here, SHORTS - 2);
        same = SHIFT(before, here, SHORTS - 1);
        ahead = here;
    } else if (shift == -1) {
        back = here;
        same = SHIFT(here, after, 1);
        ahead = SHIFT(here, after, 2);
    } else {
        back = *(__global const shorts *)(path.walled + i - shift - 1);
        same = *(__global const shorts *)(path.walled + i - shift);
        ahead = *(__global const shorts *)(path.walled + i - shift + 1);
    }
    shorts near = least(back, ahead) + path.small;
    return paid + (least(least(same, path.jump), near) - path.cheapest);
}

// Bring what the paths are to the sums of disparities i and on; those beyond the last stay what they are.
INLINE void settle(__global ushort *sum, shorts total, shorts unmatched, int i, int disparities, int room, int mode)
{
    if (mode == LEAVE) return;
    if (i + SHORTS <= room) {
        __global shorts *held = (__global shorts *)(sum + i);
        shorts value = total;
        if (mode >= ADD) value += *held;
        if (mode == FINISH) value = unmatched ? (shorts)(short)(UNMATCHED - 65536) : value;
        if (i + SHORTS > disparities) value = NUMBERS(shorts) < (short)(disparities - i) ? value : *held;
        *held = value;
    } else {
        for (int k = 0; i + k < disparities; k++) {
            ushort value = total[k];
            if (mode >= ADD) value += sum[i + k];
            if (mode == FINISH && unmatched[k]) value = UNMATCHED;
            sum[i + k] = value;
        }
    }
}

// Ask for memory that is needed soon: it lies apart from what was needed last, so that no processor guesses it.
INLINE void fetch(__global const void *from, int bytes)
{
#ifdef __AVX2__
    for (int i = 0; i < bytes; i += 64) __builtin_prefetch((const void *)((size_t)from + i));
#endif
}

INLINE shorts load(__global const short *at) { return *(__global const shorts *)at; }

// Walk one path through a pixel; the cheapest L. room tells how many costs and sums are this work-item's to touch.
INLINE int walk(
    Path path, __global const uchar *own, __global ushort *sum, int disparities, int room, int shift, int mode)
{
    shorts low = WALL, before = WALL, here = load(path.from);
    for (int i = 0; i < disparities; i += SHORTS) {
        shorts after = WALL;
        if (i + SHORTS < disparities) after = load(path.from + i + SHORTS);
        shorts paid = load_costs(own + i, room - i), unmatched = paid == (short)NO_MATCH;
        paid = unmatched ? (shorts)UNSEEN_COST : paid;
        shorts found = arrive(path, paid, before, here, after, i, shift);
        settle(sum, found, unmatched, i, disparities, room, mode);
        if (i + SHORTS > disparities) found = NUMBERS(shorts) < (short)(disparities - i) ? found : (shorts)WALL;
        *(__global shorts *)(path.to + i) = found;
        low = least(low, found);
        before = here;
        here = after;
    }
    return smallest_of(__builtin_astype(low, ushorts));
}

// Walk three paths through a pixel, and add them all to the sums; the cheapest L of each stands behind its L.
INLINE void walk_three(
    Path a, Path b, Path c, __global const uchar *own, __global ushort *sum, int disparities, int padded, int room,
    int shift)
{
    shorts low_a = WALL, before_a = WALL, here_a = load(a.from);
    shorts low_b = WALL, before_b = WALL, here_b = load(b.from);
    shorts low_c = WALL, before_c = WALL, here_c = load(c.from);
    for (int i = 0; i < disparities; i += SHORTS) {
        shorts after_a = WALL, after_b = WALL, after_c = WALL;
        if (i + SHORTS < disparities) {
            after_a = load(a.from + i + SHORTS);
            after_b = load(b.from + i + SHORTS);
            after_c = load(c.from + i + SHORTS);
        }
        shorts paid = load_costs(own + i, room - i);
        paid = paid == (short)NO_MATCH ? (shorts)UNSEEN_COST : paid;
        shorts found_a = arrive(a, paid, before_a, here_a, after_a, i, shift);
        shorts found_b = arrive(b, paid, before_b, here_b, after_b, i, shift);
        shorts found_c = arrive(c, paid, before_c, here_c, after_c, i, shift);
        settle(sum, found_a + found_b + found_c, paid, i, disparities, room, ADD);
        if (i + SHORTS > disparities) {
            shorts inside = NUMBERS(shorts) < (short)(disparities - i);
            found_a = inside ? found_a : (shorts)WALL;
            found_b = inside ? found_b : (shorts)WALL;
            found_c = inside ? found_c : (shorts)WALL;
        }
        *(__global shorts *)(a.to + i) = found_a;
        *(__global shorts *)(b.to + i) = found_b;
        *(__global shorts *)(c.to + i) = found_c;
        low_a = least(low_a, found_a);
        low_b = least(low_b, found_b);
        low_c = least(low_c, found_c);
        before_a = here_a;
        before_b = here_b;
        before_c = here_c;
        here_a = after_a;
        here_b = after_b;
        here_c = after_c;
    }
    a.to[padded] = smallest_of(__builtin_astype(low_a, ushorts));
    b.to[padded] = smallest_of(__builtin_astype(low_b, ushorts));
    c.to[padded] = smallest_of(__builtin_astype(low_c, ushorts));
}

// Whether the guide changes by an edge from pixel - step to pixel, for count pixels from one on.
INLINE void find_edges(
    __global const uchar *guide, long plane, long pixel, long step, int count, int edge, __global short *found)
{
    for (int k = 0; k < count; k += SHORTS) {
        shorts most = 0;
        for (int p = 0; p < 3; p++) {
            long at = p * plane + pixel + k, other = at - step;
            shorts mine, theirs;
            if (at >= 0 && other >= 0 && at + SHORTS <= 3 * plane && other + SHORTS <= 3 * plane) {
                mine = __builtin_convertvector(*(__global const bytes *)(guide + at), shorts);
                theirs = __builtin_convertvector(*(__global const bytes *)(guide + other), shorts);
            } else {
                mine = theirs = 0;
                for (int j = 0; j < SHORTS; j++) {
                    if (at + j < 0 || other + j < 0 || at + j >= 3 * plane || other + j >= 3 * plane) continue;
                    mine[j] = guide[at + j];
                    theirs[j] = guide[other + j];
                }
            }
            shorts change = mine > theirs ? mine - theirs : theirs - mine;
            most = change > most ? change : most;
        }
        *(__global shorts *)(found + k) = most >= (short)edge;
    }
}

// What a step costs. A path that comes from nowhere costs nothing, so that its first pixel pays its own cost alone.
typedef struct {
    int small, large, edge_small, edge_large, padded, disparities;
    __global const short *nothing;
    __global short *walled;
} Rules;

INLINE Path step_on(
    Rules rules, __global const short *from, __global short *to, int begins, int cheapest, int at_edge, int k,
    int shift)
{
    Path path;
    path.from = begins ? rules.nothing : from;
    path.to = to;
    path.walled = rules.walled;
    path.cheapest = begins ? 0 : cheapest;
    path.small = at_edge ? rules.edge_small : rules.small;
    path.jump = begins ? 0 : cheapest + (at_edge ? rules.edge_large : rules.large);
    if (shift < -1 || shift > 1) {
        __global short *walled = rules.walled + k * (rules.padded + 2 * SHORTS) + SHORTS;
        for (int i = 0; i < rules.padded; i += SHORTS) *(__global shorts *)(walled + i) = load(path.from + i);
        path.walled = walled;
    }
    return path;
}

// Both paths along row y.
INLINE void walk_row(
    Rules rules, __global const uchar *cost, __global ushort *sums, __global const short *edges, __global short *lines,
    int width)
{
    int disparities = rules.disparities, right = 0, left = 0;
    __global short *held = lines + rules.padded;
    for (int t = 0; t < width; t++) {
        int u = width - 1 - t;
        long here = (long)t * disparities, there = (long)u * disparities;
        int room = (width - t) * disparities, rest = (t + 1) * disparities;
        Path on = step_on(rules, lines, lines, t == 0, right, edges[t], 0, 0);
        Path back = step_on(rules, held, held, t == 0, left, t == 0 ? 0 : edges[u + 1], 0, 0);
        if (t + PIXELS_AHEAD < width) {
            long soon = (long)PIXELS_AHEAD * disparities;
            fetch(cost + here + soon, disparities);
            fetch(sums + here + soon, 2 * disparities);
            fetch(cost + there - soon, disparities);
            fetch(sums + there - soon, 2 * disparities);
        }
        if (t < u) {
            right = walk(on, cost + here, sums + here, disparities, room, 0, SET);
            left = walk(back, cost + there, sums + there, disparities, rest, 0, SET);
        } else {
            if (t == u) right = walk(on, cost + here, sums + here, disparities, room, 0, SET);
            else right = walk(on, cost + here, sums + here, disparities, room, 0, FINISH);
            left = walk(back, cost + there, sums + there, disparities, rest, 0, FINISH);
        }
    }
}

// The three paths in columns first to last - 1 over the rows of a band. Lines of paths keep their places while they
// lean: paths of a kind are `kind` apart, those before the band's first row and after its last one `pictured` apart.
INLINE void walk_band(
    Rules rules, __global const uchar *cost, __global const uchar *guide, __global ushort *sums,
    __global short *lines, __global const short *entering, __global short *leaving, __global short *edges, long kind,
    long pictured, int width, int height, int first, int last, int begin, int rows, int heading, int edge, int shift)
{
    int disparities = rules.disparities, padded = rules.padded, stride = padded + SHORTS;
    int span = WIDEST + 2 * BAND + SHORTS;
    for (int r = 0; r < rows; r++) {
        int left = rows - 1 - r, y = heading > 0 ? begin + r : height - 1 - begin - r;
        int from = first - left > 0 ? first - left : 0, to = last + left < width ? last + left : width;
        int begins = begin + r == 0;
        long row = (long)y * width;
        if (!begins) {
            for (int k = 0; k < 3; k++) {
                int side = k == 2 ? -1 : k;
                find_edges(
                    guide, (long)width * height, row + from, (long)heading * width + side, to - from, edge,
                    edges + k * span);
            }
        }
        for (int x = from; x < to; x++) {
            long pixel = row + x;
            __global const uchar *own = cost + pixel * disparities;
            // Lines are numbered by where they stand in the band's first row or, of those that lean to the right,
            // in its last one.
            __global short *a = lines + (long)(x - first) * stride;
            __global short *b = lines + kind + (long)(x - first + left) * stride;
            __global short *c = lines + 2 * kind + (long)(x - first + r) * stride;
            __global const short *old_a = r ? a : entering + (long)x * stride;
            __global const short *old_b = r ? b : entering + pictured + (long)(x - 1) * stride;
            __global const short *old_c = r ? c : entering + 2 * pictured + (long)(x + 1) * stride;
            if (r == rows - 1) {
                a = leaving + (long)x * stride;
                b = a + pictured;
                c = b + pictured;
            }
            int begins_b = begins || x == 0, begins_c = begins || x == width - 1, room;
            __global const short *at_edge = edges + (x - from);
            if (x < first) {
                room = (width - x) * disparities;
                Path path = step_on(
                    rules, old_b, b, begins_b, begins_b ? 0 : old_b[padded], begins ? 0 : at_edge[span], 0, shift);
                b[padded] = walk(path, own, sums, disparities, room, shift, LEAVE);
            } else if (x >= last) {
                room = (width - x) * disparities;
                Path path = step_on(
                    rules, old_c, c, begins_c, begins_c ? 0 : old_c[padded], begins ? 0 : at_edge[2 * span], 0, shift);
                c[padded] = walk(path, own, sums, disparities, room, shift, LEAVE);
            } else {
                room = (last - x) * disparities;
                Path path_a = step_on(
                    rules, old_a, a, begins, begins ? 0 : old_a[padded], begins ? 0 : at_edge[0], 0, shift);
                Path path_b = step_on(
                    rules, old_b, b, begins_b, begins_b ? 0 : old_b[padded], begins ? 0 : at_edge[span], 1, shift);
                Path path_c = step_on(
                    rules, old_c, c, begins_c, begins_c ? 0 : old_c[padded], begins ? 0 : at_edge[2 * span], 2, shift);
                __global ushort *sum = sums + pixel * disparities;
                if (left > 0) {
                    long next = (pixel + (long)heading * width) * disparities;
                    fetch(cost + next, disparities);
                    fetch(sums + next, 2 * disparities);
                }
                walk_three(path_a, path_b, path_c, own, sum, disparities, padded, room, shift);
            }
        }
    }
}

// What aggregate.cl computes. scratch holds for each work-item a path from nowhere, room for three paths with walls,
// edges, and the strip's lines; after those the rows of paths that pass from stage to stage.
__kernel void aggregate(
    // In:
    __global const uchar *cost,
    __global const uchar *guide,
    int width,
    int height,
    int disparities,
    int heading,
    int row_slope,
    int small_penalty,
    int large_penalty,
    int edge_small_penalty,
    int edge_large_penalty,
    int edge,
    int stage,
    __global float *scratch,
    // Out:
    __global ushort *sums_out)
{
    int padded = (disparities + SHORTS - 1) / SHORTS * SHORTS, stride = padded + SHORTS, item = get_global_id(0);
    int strips = get_global_size(0), shift = row_slope * heading;
    Rules rules = {
        small_penalty, large_penalty, edge_small_penalty, edge_large_penalty, padded, disparities, 0, 0};
    long common = stride + 3 * (padded + 2 * SHORTS);
    if (heading == 0) {
        long room = common + 2 * padded + (width + SHORTS) / SHORTS * SHORTS + SHORTS;
        __global short *own = (__global short *)scratch + item * room, *edges = own + common + 2 * padded;
        for (int i = 0; i < stride; i += SHORTS) *(__global shorts *)(own + i) = 0;
        rules.nothing = own;
        int2 rows = band_of_rows(height);
        for (int y = rows.x; y < rows.y; y++) {
            long row = (long)y * width;
            find_edges(guide, (long)width * height, row, 1, width, edge, edges);
            walk_row(rules, cost + row * disparities, sums_out + row * disparities, edges, own + common, width);
        }
        return;
    }
    int columns = (width + strips - 1) / strips, first = item * columns;
    int last = first + columns < width ? first + columns : width, begin = stage * BAND;
    if (first >= last) return;
    int rows = begin + BAND < height ? BAND : height - begin, span = WIDEST + 2 * BAND + SHORTS;
    long kind = (long)(columns + (height < BAND ? height : BAND)) * stride, pictured = (long)width * stride;
    long room = common + 3 * span + 3 * kind;
    __global short *own = (__global short *)scratch + item * room, *edges = own + common, *lines = edges + 3 * span;
    __global short *passed = (__global short *)scratch + strips * room;
    __global short *entering = passed + (stage & 1) * 3 * pictured, *leaving = passed + (1 - (stage & 1)) * 3 * pictured;
    for (int i = 0; i < stride; i += SHORTS) *(__global shorts *)(own + i) = 0;
    rules.nothing = own;
    rules.walled = own + stride;
    for (int i = 0; i < common - stride; i += SHORTS) *(__global shorts *)(rules.walled + i) = WALL;
#define WALK(SHIFT) \
    walk_band( \
        rules, cost, guide, sums_out, lines, entering, leaving, edges, kind, pictured, width, height, first, last, begin, \
        rows, heading, edge, SHIFT)
    if (shift == 0) WALK(0);
    else if (shift == 1) WALK(1);
    else if (shift == -1) WALK(-1);
    else WALK(shift);
}
