// Find the pixels of flat, textureless surfaces that are better off with the plane of their surroundings: the form for
// CPUs. A work-item takes a band of rows, in blocks of columns, and first spreads the sums of each column of planes
// over the pixels next to it, so that planes of LANES pixels are mixed at a time. Windows are compared for LANES
// pixels at a time too, where one of them asks.
#include "lanes.h"
#include "flat_pixel.h"
#include "quarters.h"
#define INLINE inline __attribute__((always_inline))
#define SPAN (40 * LANES)
#define LINE (SPAN + LANES)
#define ACROSS (2 * WINDOW_REACH + 1)
// Lines of a block: members of Column for the planes to the left and to the right of each pixel, the pixel's distances
// to their centres, and the weight of the right one.
#define MEMBERS 5
#define FROM_LEFT (2 * MEMBERS)
#define FROM_RIGHT (FROM_LEFT + 1)
#define RIGHT_WEIGHT (FROM_RIGHT + 1)
#define LINES (RIGHT_WEIGHT + 1)

#ifdef __AVX512BW__
#define WIDE 1.0e9f
typedef float raw_lanes __attribute__((vector_size(4 * LANES), aligned(4)));
typedef int raw_places __attribute__((vector_size(4 * LANES)));

// The floats at places 0 to 31 in memory.
INLINE lanes look_up(__global const float *from, int_lanes place)
{
    raw_lanes left = *(__global const raw_lanes *)from, right = *(__global const raw_lanes *)(from + LANES);
    return __builtin_astype(__builtin_ia32_vpermi2varps512(left, __builtin_astype(place, raw_places), right), lanes);
}

INLINE float smallest(lanes v)
{
    float8 eight = v.lo < v.hi ? v.lo : v.hi;
    float4 four = eight.lo < eight.hi ? eight.lo : eight.hi;
    float2 two = four.lo < four.hi ? four.lo : four.hi;
    return two.x < two.y ? two.x : two.y;
}
#endif

INLINE int_lanes clamp_lanes(int_lanes index, int size)
{
    index = index < 0 ? 0 : index;
    return index < size ? index : size - 1;
}

// The floats of a row at any of its columns.
inline lanes pick(__global const float *row, int_lanes columns)
{
    const int *column = (const int *)&columns;
    lanes found;
    for (int k = 0; k < LANES; k++) found[k] = row[column[k]];
    return found;
}

// Columns from x on of a row, NaN outside of the picture.
INLINE lanes load_some(__global const float *row, int x, int width)
{
    if (x + LANES <= width) return *(__global const lanes *)(row + x);
    lanes found = NAN;
    for (int k = 0; x + k < width; k++) found[k] = row[x + k];
    return found;
}

INLINE void add_sample(lanes *sum, lanes *squares, lanes ours, lanes left, lanes right, lanes share)
{
    lanes rest = ours - (left * (1.0f - share) + right * share);
    *sum += rest;
    *squares += rest * rest;
}

// The same as in flat_pixel.h for LANES pixels from x on; what it says of those that do not ask means nothing. With
// leans 0, slopes are.
INLINE lanes unexplained_lanes(
    __global const float *reference, __global const float *other, int x, int y, int width, int height, float way,
    lanes disparity, lanes along_x, lanes along_y, int_lanes asks, int leans)
{
    lanes lane = __builtin_convertvector(lane_numbers(), lanes), columns = lane + (float)x;
    int_lanes own = lane_numbers() + x;
    // How far to the right of its own column each pixel of a window looks, at least and at most.
    lanes about = leans ? (float)WINDOW_REACH * (magnitude(along_x) + magnitude(along_y)) : (lanes)(0.0f);
    lanes least = way * disparity - about, most = way * disparity + about;
    int beyond = x < WINDOW_REACH || x + LANES + WINDOW_REACH > width;
    beyond = beyond || any_lane(asks & (columns + least < 5.0f | columns + most > (float)(width - 8)));
#ifdef __AVX512BW__
    // On a smooth surface all lanes sample among the same two vectors.
    int start = floor_to_int(smallest(asks ? lane + least : WIDE)) - 1;
    int near_by = !beyond && -smallest(asks ? -lane - most : WIDE) < (float)(start + 2 * LANES - 4)
                  && (long)clamp_index(y + WINDOW_REACH, height) * width + x + start + 2 * LANES + ACROSS
                         <= (long)width * height;
#endif
    lanes sum = 0.0f, squares = 0.0f;
    lanes shift = way * disparity, whole = floor_lanes(shift), share = shift - whole;
    int_lanes index = __builtin_convertvector(whole, int_lanes);
    for (int j = -WINDOW_REACH; j <= WINDOW_REACH; j++) {
        long row = (long)clamp_index(y + j, height) * width;
        __global const float *ours = reference + row, *theirs = other + row;
        lanes surface = disparity + along_y * (float)j;
        lanes left, right, third, fourth;
#ifdef __AVX512BW__
        if (near_by && !leans) {
            left = look_up(theirs + x - WINDOW_REACH + start, index - start + lane_numbers());
            UNROLL for (int i = -WINDOW_REACH; i <= WINDOW_REACH; i++) {
                right = look_up(theirs + x + i + 1 + start, index - start + lane_numbers());
                add_sample(&sum, &squares, *(__global const lanes *)(ours + x + i), left, right, share);
                left = right;
            }
            continue;
        }
#endif
        for (int i = -WINDOW_REACH; i <= WINDOW_REACH; i++) {
            if (leans) {
                shift = way * (surface + along_x * (float)i);
                whole = floor_lanes(shift);
                share = shift - whole;
                index = __builtin_convertvector(whole, int_lanes);
            }
            if (beyond) {
                int_lanes column = clamp_lanes(own + i, width), u = column + index;
                left = pick(theirs, clamp_lanes(u, width));
                right = pick(theirs, clamp_lanes(u + 1, width));
                add_sample(&sum, &squares, pick(ours, column), left, right, share);
                continue;
            }
#ifdef __AVX512BW__
            if (near_by) {
                int_lanes place = index - start + lane_numbers();
                left = look_up(theirs + x + i + start, place);
                right = look_up(theirs + x + i + 1 + start, place);
            } else
#endif
                load_fours(theirs, clamp_lanes(own + i + index, width - 3), &left, &right, &third, &fourth);
            add_sample(&sum, &squares, *(__global const lanes *)(ours + x + i), left, right, share);
        }
    }
    lanes mean = sum * WINDOW_SHARE, variance = squares * WINDOW_SHARE - mean * mean;
    return variance > 0.0f ? variance : 0.0f;
}

// Lay a number out from one place to another, or up to a vector further.
INLINE void spread(float *line, int from, int to, float value)
{
    for (int k = from; k < to; k += LANES) *(lanes *)(line + k) = (lanes)(value);
}

INLINE void spread_column(float (*lines)[LINE], int from, int to, Column sums)
{
    spread(lines[0], from, to, sums.weight);
    spread(lines[1], from, to, sums.value);
    spread(lines[2], from, to, sums.along_x);
    spread(lines[3], from, to, sums.along_y);
    spread(lines[4], from, to, sums.share);
}

// What flat.cl computes.
__kernel void flat(
    // In:
    __global const float *reference,
    __global const float *other,
    __global const float *planes,
    __global const float *disparity,
    __global const float *agreement,
    int width,
    int height,
    int planes_wide,
    int planes_high,
    int pitch,
    int direction,
    float noise,
    float least_agreement,
    float least_share,
    // Out:
    __global float *plane_out,
    __global float *along_x_out,
    __global float *along_y_out,
    __global uchar *wanted_out)
{
    int2 band = band_of_rows(height);
    float lines[LINES][LINE] ALIGNED, way = (float)direction;
    for (int start = 0; start < width; start += SPAN) {
        int columns = start + SPAN < width ? SPAN : (width - start + LANES - 1) / LANES * LANES;
        int before = centre_before(start, pitch);
        for (int k = 0; k < columns; k++) {
            int x = start + k, centre = centre_before(x, pitch);
            lines[FROM_LEFT][k] = 0.5f * (float)halves_from(x, clamp_index(centre, planes_wide), pitch);
            lines[FROM_RIGHT][k] = 0.5f * (float)halves_from(x, clamp_index(centre + 1, planes_wide), pitch);
            lines[RIGHT_WEIGHT][k] = (float)halves_from(x, centre, pitch);
        }
        for (int y = band.x; y < band.y; y++) {
            long place = (long)y * width;
            Column sums = column_at(planes, before, y, planes_wide, planes_high, pitch);
            for (int column = before, from = 0; from < columns; column++) {
                // Up to the next centre.
                int to = (column + 1) * pitch + pitch / 2 - start;
                to = to < columns ? to : columns;
                spread_column(lines, from, to, sums);
                sums = column_at(planes, column + 1, y, planes_wide, planes_high, pitch);
                spread_column(lines + MEMBERS, from, to, sums);
                from = to;
            }
            for (int k = 0; k < columns; k += LANES) {
                int x = start + k;
#define AT(line) (*(lanes *)(lines[line] + k))
                lanes right = AT(RIGHT_WEIGHT), left = (float)(2 * pitch) - right;
                lanes weight = left * AT(0) + right * AT(MEMBERS);
                int_lanes found = weight > 0.0f;
                lanes one = 1.0f / weight;
                lanes plane = left * (AT(1) + AT(2) * AT(FROM_LEFT));
                plane += right * (AT(MEMBERS + 1) + AT(MEMBERS + 2) * AT(FROM_RIGHT));
                plane = found ? plane * one : NAN;
                lanes along_x = found ? (left * AT(2) + right * AT(MEMBERS + 2)) * one : 0.0f;
                lanes along_y = found ? (left * AT(3) + right * AT(MEMBERS + 3)) * one : 0.0f;
                lanes share = (left * AT(4) + right * AT(MEMBERS + 4)) * one;
                store_lanes(plane_out + place, x, width, plane);
                store_lanes(along_x_out + place, x, width, along_x);
                store_lanes(along_y_out + place, x, width, along_y);
                lanes agreed = load_some(agreement + place, x, width);
                int_lanes wanted = found & share > least_share & agreed < least_agreement;
                if (any_lane(wanted)) {
                    lanes mine = unexplained_lanes(
                        reference, other, x, y, width, height, way, plane, along_x, along_y, wanted, 1);
                    lanes u = __builtin_convertvector(lane_numbers(), lanes) + (float)x + way * plane;
                    wanted &= mine <= MOST * noise | u < 0.0f | u > (float)(width - 1);
                    lanes given = load_some(disparity + place, x, width);
                    int_lanes asks = wanted & given == given;
                    if (any_lane(asks)) {
                        lanes theirs = unexplained_lanes(
                            reference, other, x, y, width, height, way, given, (lanes)(0.0f), (lanes)(0.0f), asks, 0);
                        wanted &= ~asks | mine <= theirs + WORSE * noise;
                    }
                }
                store_reasons(wanted_out + place, x, width, wanted & 1);
            }
        }
    }
}
