// The winners of both views among the keys of SPAN columns and a chunk of GROUP disparities, found by a work-group.
//
// keys holds SPAN x PITCH keys in local memory; keys[s * PITCH + k] is that of column s and of the other view's
// column u0 + k + s, so that the disparities run with k or against it.
#define GROUP 64 // as in kernels/geometry.py; every device runs so many, and needs 4 KiB of local memory for them
#define SPAN 8
#define CLASSES (GROUP / SPAN) // work-items that share the search for the winner of a column
#define PITCH 72 // keys of a column and zeros beyond them; four columns lie in different banks

// The two highest keys that a work-item has seen so far, after every CLASSES-th one of a column. Neighbouring
// disparities are in different classes, so that of the winner and its neighbours none hides the runner-up.
inline void search_column(__local const int *keys, int lane, int *high, int *second)
{
    __local const int *column = keys + lane / CLASSES * PITCH + (lane & (CLASSES - 1));
    for (int k = 0; k < GROUP; k += CLASSES) {
        int key = column[k], lower = key < *high ? key : *high;
        *second = lower > *second ? lower : *second;
        *high = key > *high ? key : *high;
    }
}

// Raise the other view's winners, from column u0 of its row on, to the highest of the keys.
inline void raise_winners(__local const int *keys, int lane, __global int *row, int u0, int width)
{
    // The keys of one u lie on a diagonal, and zeros beyond its ends.
    for (int k = lane; k < GROUP + SPAN - 1; k += GROUP) {
        int key = 0;
        for (int s = 0; s < SPAN; s++) {
            int next = keys[s * (PITCH - 1) + k];
            key = next > key ? next : key;
        }
        if (key > 0 && u0 + k >= 0 && u0 + k < width) atomic_max(row + u0 + k, key);
    }
}

// The four highest of the keys that the work-items of a column saw, two each.
inline int4 highest_four(__local const int *highest, __local const int *seconds)
{
    int4 four = (int4)(0);
    for (int k = 0; k < 2 * CLASSES; k++) {
        int key = k < CLASSES ? highest[k] : seconds[k - CLASSES], lower = key < four.x ? key : four.x;
        four.x = key > four.x ? key : four.x;
        key = lower;
        lower = key < four.y ? key : four.y;
        four.y = key > four.y ? key : four.y;
        key = lower;
        lower = key < four.z ? key : four.z;
        four.z = key > four.z ? key : four.z;
        four.w = lower > four.w ? lower : four.w;
    }
    return four;
}

// Whether the disparities of two keys are more than one place apart.
inline int apart(int a, int b, int bits)
{
    int places = key_index(a, bits) - key_index(b, bits);
    return places < -1 || places > 1;
}

// The level of the runner-up: of the three after the winner, two at most are its neighbours.
inline int runner_level(int4 four, int bits)
{
    return (apart(four.x, four.y, bits) ? four.y : apart(four.x, four.z, bits) ? four.z : four.w) >> bits;
}
