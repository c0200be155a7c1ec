// Vectors of neighbours and of how much they look alike, for the forms that are made for CPUs; needs lanes.h and
// likeness.h. A work-item takes SPAN pixels of a row at a time, whose bytes are one vector.
#define GROUP 4
#define SPAN (GROUP * LANES)
#define MOST_ACROSS 9 // neighbours side by side that lines hold, and columns on either side; pixel by pixel with more
#define MARGIN 16
#define LINE (SPAN + 2 * MARGIN + LANES)
typedef uchar bytes __attribute__((ext_vector_type(SPAN), aligned(1)));

// Rows of neighbours around SPAN pixels: how far they lie apart, a line of bytes for each plane, 0 for masked ones.
typedef struct {
    float disparity[MOST_ACROSS][LINE];
    uchar guide[MOST_ACROSS][3][LINE];
    uchar counts[MOST_ACROSS][LINE];
} Lines;

// Columns from p on of a row of bytes, SPAN + 2 * margin of them; outside of the picture `beyond`.
inline void load_bytes(uchar *line, __global const uchar *row, int p, int columns, int width, uchar beyond)
{
    for (int k = 0; k < columns; k += LANES) {
        if (p + k >= 0 && p + k + LANES <= width) {
            *(uchar_lanes *)(line + k) = *(__global const uchar_lanes *)(row + p + k);
            continue;
        }
        for (int j = k; j < k + LANES; j++) line[j] = p + j >= 0 && p + j < width ? row[p + j] : beyond;
    }
}

// The rows first to last of the neighbours, `step` apart, of SPAN pixels from column x on of row y.
inline void load_neighbours(
    Lines *lines, __global const float *disparity, __global const uchar *validity, __global const uchar *guide, int x,
    int y, int width, int height, int first, int last, int step, int margin)
{
    long plane = (long)width * height;
    int columns = SPAN + 2 * margin;
    for (int j = first; j <= last; j++) {
        long row = (long)(y + j * step) * width;
        int k = j - first;
        load_line(lines->disparity[k], disparity + row, x - margin, columns, width, 0);
        for (int i = 0; i < 3; i++) load_bytes(lines->guide[k][i], guide + i * plane + row, x - margin, columns, width, 0);
        load_bytes(lines->counts[k], validity + row, x - margin, columns, width, MASKED);
        for (int i = 0; i < columns; i += LANES) {
            uchar_lanes reasons = *(uchar_lanes *)(lines->counts[k] + i);
            *(uchar_lanes *)(lines->counts[k] + i) = __builtin_astype((reasons & (uchar)MASKED) == (uchar)0, uchar_lanes);
        }
    }
}

// max(0, a - b)
inline bytes above(bytes a, bytes b) { return (a > b ? a : b) - b; }

inline bytes bytes_apart(bytes a, bytes b) { return (a > b ? a : b) - (a < b ? a : b); }

// a + b, or 255 if that is less
inline bytes add_up(bytes a, bytes b)
{
    bytes room = ~b;
    return (a < room ? a : room) + b;
}

// UNLIKE - difference of each pixel and its neighbour, whose bytes stand at `at` in a line; 0 where they do not count.
inline bytes alike(const Lines *lines, int k, int at, bytes a, bytes b, bytes c)
{
    bytes difference = bytes_apart(*(const bytes *)(lines->guide[k][0] + at), a);
    difference = add_up(difference, bytes_apart(*(const bytes *)(lines->guide[k][1] + at), b));
    difference = add_up(difference, bytes_apart(*(const bytes *)(lines->guide[k][2] + at), c));
    return above((bytes)(UNLIKE), difference) & *(const bytes *)(lines->counts[k] + at);
}

// The same as likeness in likeness.h.
inline lanes likenesses(uchar_lanes alike)
{
    lanes t = __builtin_convertvector(__builtin_convertvector(alike, int_lanes), lanes) * (1.0f / UNLIKE);
    t = t * t;
    t = t * t;
    return t * t;
}
