// How many places of square windows a flag is set at, for the forms for CPUs; needs lanes.h.
//
// Counts of columns run down a work-item's band of rows; differences of their prefix sums along the row are those of
// windows, so that the window's size hardly matters.
#define BOX_SPAN (BLOCK + LANES)

typedef struct {
    int columns[BOX_SPAN] ALIGNED; // of the window's rows, for each column
    int before[BOX_SPAN] ALIGNED; // those of all columns to the left
} BoxCounts;

// Columns that fit at a time, with a window's around them; a radius is under half a block.
inline int box_columns(int radius) { return BLOCK - 2 * radius; }

inline void clear_counts(BoxCounts *counts, int places)
{
    for (int k = 0; k < places; k += LANES) *(int_lanes *)(counts->columns + k) = (int_lanes)(0);
}

// Add up the columns before each of so many places.
inline void sum_counts(BoxCounts *counts, int places)
{
    int sum = 0;
    for (int k = 0; k < places; k++) {
        counts->before[k] = sum;
        sum += counts->columns[k];
    }
    counts->before[places] = sum;
}

// Windows of LANES pixels from place k on.
inline int_lanes window_counts(const BoxCounts *counts, int k, int radius)
{
    return *(const int_lanes *)(counts->before + k + 2 * radius + 1) - *(const int_lanes *)(counts->before + k);
}

// Pixels of windows from column x on that lie in the picture, of so many rows.
inline int_lanes window_pixels(int x, int radius, int width, int rows)
{
    int_lanes left = lane_numbers() + (x - radius), right = lane_numbers() + (x + radius);
    left = left > 0 ? left : 0;
    right = right < width ? right : width - 1;
    return (right - left + 1) * rows;
}
