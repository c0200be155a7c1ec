// Fit robust planes through the cells around them: the form for CPUs, whose work-items take a band of rows of planes
// each, and whose lanes are planes side by side.
#include "lanes.h"
#include "robust_plane.h"
#define HIGHEST 33 // rows of cells that are held, at most
#define LINE 128   // and cells of a row

// The cells around LANES planes, of each its weight, column, row and disparity. Every spacing-th of a row stands beside
// the other, so that those as far from each of the planes do. Rows are held until those HIGHEST further down come.
typedef struct {
    float at[HIGHEST][4][LINE];
} Cells;

// Of the rows of cells around a plane, where those within reach begin and end.
typedef struct {
    int first[HIGHEST], last[HIGHEST];
} Disc;

// How far at least a place in the cells at `offset` from a plane's own first one is from its middle along an axis, px.
inline float least_apart(int offset, int cell, int spacing)
{
    float middle = 0.5f * (float)(cell * spacing - 1), begins = (float)(offset * cell), ends = begins + (float)(cell - 1);
    float apart = begins > middle ? begins - middle : middle > ends ? middle - ends : 0.0f;
    return apart > 0.5f ? apart - 0.5f : 0.0f; // rounding may carry a mean out of its cell
}

inline void lay_out(Disc *disc, int rows, int cell, int spacing, int reach)
{
    float furthest = (float)(cell * reach);
    for (int j = 0; j < rows; j++) {
        float down = least_apart(spacing / 2 - reach + j, cell, spacing);
        disc->first[j] = rows;
        disc->last[j] = -1;
        for (int i = 0; i < rows; i++) {
            float across = least_apart(spacing / 2 - reach + i, cell, spacing);
            if (across * across + down * down >= furthest * furthest) continue;
            if (i < disc->first[j]) disc->first[j] = i;
            disc->last[j] = i;
        }
    }
}

inline void load_cells(
    Cells *held, __global const float *cells, int cells_wide, int cells_high, int left, int y, int slot, int spacing,
    int pitch)
{
    int inside = y >= 0 && y < cells_high;
    for (int i = 0; i < 4; i++) {
        __global const float *row = cells + ((long)i * cells_high + (inside ? y : 0)) * cells_wide;
        for (int phase = 0; phase < spacing; phase++) {
            float *line = held->at[slot][i] + phase * pitch;
            for (int k = 0, x = left + phase; k < pitch; k++, x += spacing)
                line[k] = inside && x >= 0 && x < cells_wide ? row[x] : 0.0f;
        }
    }
}

// The same as in robust_plane.h for LANES planes from column `first` of a row on, whose uppermost cells are at `slot`.
inline __attribute__((always_inline)) void fit_planes(
    const Cells *held, const Disc *disc, int planes_wide, long planes, int first, int row, int slot, int cell,
    int spacing, int reach, int pitch, float tolerance, __global float *planes_out)
{
    int side = cell * spacing, rows = 2 * reach + 1;
    lanes centre_x = __builtin_convertvector((lane_numbers() + first) * side, lanes) + 0.5f * (float)(side - 1);
    float centre_y = (float)(row * side) + 0.5f * (float)(side - 1);
    float furthest = (float)(cell * reach), inverse = 1.0f / (furthest * furthest);
    float stiff = FIT_STIFF * (float)(cell * cell), sharpness = 0.0f;
    lanes value = 0.0f, along_x = 0.0f, along_y = 0.0f;
    int_lanes fits = -1;
    lanes nears[HIGHEST * HIGHEST];
    for (int round = 0; round < FITS; round++) {
        lanes n = 0.0f, sum_x = 0.0f, sum_y = 0.0f, sum_v = 0.0f;
        lanes sum_xx = 0.0f, sum_xy = 0.0f, sum_yy = 0.0f, sum_xv = 0.0f, sum_yv = 0.0f;
        lanes *kept = nears;
        for (int j = 0; j < rows; j++) {
            const float (*line)[LINE] = held->at[(slot + j) % HIGHEST];
            // The place of the i-th cell: i % spacing and i / spacing.
            int phase = disc->first[j] % spacing, k = disc->first[j] / spacing;
            for (int i = disc->first[j]; i <= disc->last[j]; i++) {
                int at = phase * pitch + k;
                lanes dx = *(const lanes *)(line[1] + at) - centre_x;
                lanes dy = *(const lanes *)(line[2] + at) - centre_y;
                lanes v = *(const lanes *)(line[3] + at) - value;
                lanes weight;
                if (!round) {
                    lanes near = 1.0f - (dx * dx + dy * dy) * inverse;
                    near = near > 0.0f ? near : 0.0f;
                    weight = *(const lanes *)(line[0] + at) * (near * near * near);
                    *kept++ = weight;
                } else {
                    weight = *kept++;
                    lanes off = (v - along_x * dx - along_y * dy) * sharpness;
                    lanes like = 1.0f / (1.0f + off * off);
                    weight *= like * like;
                }
                lanes weighted_x = weight * dx, weighted_y = weight * dy;
                n += weight;
                sum_x += weighted_x;
                sum_y += weighted_y;
                sum_v += weight * v;
                sum_xx += weighted_x * dx;
                sum_xy += weighted_x * dy;
                sum_yy += weighted_y * dy;
                sum_xv += weighted_x * v;
                sum_yv += weighted_y * v;
                if (++phase == spacing) {
                    phase = 0;
                    k++;
                }
            }
        }
        // Where there is no plane what follows is no number, and stays so.
        fits &= n > FIT_ENOUGH;
        if (!any_lane(fits)) break;
        lanes one = 1.0f / n, mean_x = sum_x * one, mean_y = sum_y * one;
        lanes xx = sum_xx - sum_x * mean_x + stiff * n, yy = sum_yy - sum_y * mean_y + stiff * n;
        lanes xy = sum_xy - sum_x * mean_y, xv = sum_xv - sum_v * mean_x, yv = sum_yv - sum_v * mean_y;
        lanes area = xx * yy - xy * xy;
        along_x = (xv * yy - yv * xy) / area;
        along_y = (yv * xx - xv * xy) / area;
        along_x = along_x < -STEEPEST ? -STEEPEST : along_x > STEEPEST ? STEEPEST : along_x;
        along_y = along_y < -STEEPEST ? -STEEPEST : along_y > STEEPEST ? STEEPEST : along_y;
        value += sum_v * one - along_x * mean_x - along_y * mean_y;
        sharpness = round ? 2.0f * sharpness : 1.0f / WIDEST_SCALE;
    }
    lanes whole = 0.0f, on_it = 0.0f, *kept = nears;
    for (int j = 0; j < rows && any_lane(fits); j++) {
        const float (*line)[LINE] = held->at[(slot + j) % HIGHEST];
        int phase = disc->first[j] % spacing, k = disc->first[j] / spacing;
        for (int i = disc->first[j]; i <= disc->last[j]; i++) {
            int at = phase * pitch + k;
            lanes dx = *(const lanes *)(line[1] + at) - centre_x;
            lanes dy = *(const lanes *)(line[2] + at) - centre_y;
            lanes off = *(const lanes *)(line[3] + at) - value - along_x * dx - along_y * dy, weight = *kept++;
            whole += weight;
            on_it += magnitude(off) <= tolerance ? weight : 0.0f;
            if (++phase == spacing) {
                phase = 0;
                k++;
            }
        }
    }
    __global float *out = planes_out + (long)row * planes_wide;
    store_lanes(out, first, planes_wide, fits ? value : NAN);
    store_lanes(out + planes, first, planes_wide, fits ? along_x : 0.0f);
    store_lanes(out + 2 * planes, first, planes_wide, fits ? along_y : 0.0f);
    store_lanes(out + 3 * planes, first, planes_wide, fits ? on_it / whole : 0.0f);
}

// A plane stands in the middle of every block of spacing x spacing cells, and is a least squares fit through the
// cells within `reach` of it. Cells weigh by their own weight and (1 - r^2 / R^2)^3 at a distance of r of R px, and
// from the second of four fits on by (1 / (1 + (e / scale)^2))^2 where they are e px off the plane (Geman and McClure
// 1987), with scales of 4, 2 and 1 px. Of each plane its value in its middle, its slopes along x and y, and the
// weight of the cells within tolerance px of it over the weight of all, a plane of the output each; NaN and zeros
// where no cell is near.
__kernel void planes(
    // In:
    __global const float *cells,
    int cells_wide,
    int cells_high,
    int planes_wide,
    int planes_high,
    int cell,
    int spacing,
    int reach,
    float tolerance,
    // Out:
    __global float *planes_out)
{
    int2 band = band_of_rows(planes_high);
    int rows = 2 * reach + 1, pitch = LANES + 2 * reach / spacing + 1, corner = spacing / 2 - reach;
    int holds = rows <= HIGHEST && spacing <= HIGHEST && spacing * pitch <= LINE;
    Cells held;
    Disc disc;
    if (holds) lay_out(&disc, rows, cell, spacing, reach);
    for (int first = 0; first < planes_wide; first += LANES) {
        int slot = 0, loaded = 0;
        for (int row = band.x; row < band.y; row++) {
            if (!holds) {
                for (int column = first; column < planes_wide && column < first + LANES; column++)
                    fit_plane(cells, cells_wide, cells_high, planes_wide, planes_high, column, row, cell, spacing, reach,
                              tolerance, planes_out);
                continue;
            }
            // The rows that the planes above do not share.
            for (int j = loaded; j < rows; j++)
                load_cells(&held, cells, cells_wide, cells_high, first * spacing + corner, row * spacing + corner + j,
                           (slot + j) % HIGHEST, spacing, pitch);
            fit_planes(&held, &disc, planes_wide, (long)planes_wide * planes_high, first, row, slot, cell, spacing, reach,
                       pitch, tolerance, planes_out);
            loaded = rows > spacing ? rows - spacing : 0;
            slot = (slot + spacing) % HIGHEST;
        }
    }
}
