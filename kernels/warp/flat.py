"""Find the pixels of flat, textureless surfaces that are better off with the plane of their surroundings."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

LEAST_WEIGHT = wp.constant(1e-4)  # of a plane that nothing agrees with
WINDOW_REACH = wp.constant(2)  # of the windows that are compared, px
WINDOW_SHARE = wp.constant(0.04)  # one over their 25 pixels
WORSE = wp.constant(1.5)  # how much more than the disparity given a plane may leave unexplained, in noise
MOST = wp.constant(16.0)  # how much it may leave at all, in noise, where the other view sees it

Column = wp.types.vector(5, float)


@wp.func
def centre_before(x: int, pitch: int) -> int:
    """The number of the last centre that is not to the right of (below) a pixel, from -1 on.

    Centres lie pitch px apart, the first one in the middle of the first pitch pixels.
    """
    return (2 * x + 1 + pitch) // (2 * pitch) - 1


@wp.func
def halves_from(x: int, centre: int, pitch: int) -> int:
    """How far in half px a pixel lies from a centre."""
    return 2 * x - (pitch - 1) - 2 * pitch * centre


@wp.func
def column_at(
    planes: wp.array(dtype=float), column: int, y: int, planes_wide: int, planes_high: int, pitch: int
) -> Column:
    """Of the two planes of a column next to a row: the weight, and weighted value, slopes and share.

    The value is that in the row at the column's centre. Weights are those of bilinear interpolation, in half px, times
    the cube of a plane's share.
    """
    before = centre_before(y, pitch)
    past = halves_from(y, before, pitch)
    size = planes_wide * planes_high
    sums = Column()
    for j in range(2):
        row = wp.clamp(before + j, 0, planes_high - 1)
        at = row * planes_wide + wp.clamp(column, 0, planes_wide - 1)
        if not wp.isnan(planes[at]):
            slope = planes[2 * size + at]
            share = planes[3 * size + at]
            weight = float(wp.where(j == 1, past, 2 * pitch - past))
            weight *= share * share * share + LEAST_WEIGHT
            sums[0] += weight
            sums[1] += weight * (planes[at] + slope * (0.5 * float(halves_from(y, row, pitch))))
            sums[2] += weight * planes[size + at]
            sums[3] += weight * slope
            sums[4] += weight * share
    return sums


@wp.func
def unexplained(
    reference: wp.array(dtype=float),
    other: wp.array(dtype=float),
    x: int,
    y: int,
    width: int,
    height: int,
    direction: float,
    disparity: float,
    along_x: float,
    along_y: float,
) -> float:
    """Variance of what is left between the views over the window around a pixel, edges repeated.

    The disparity changes by along_x and along_y px a pixel.
    """
    total = float(0.0)
    squares = float(0.0)
    for j in range(-WINDOW_REACH, WINDOW_REACH + 1):
        row = wp.clamp(y + j, 0, height - 1) * width
        surface = disparity + along_y * float(j)
        for i in range(-WINDOW_REACH, WINDOW_REACH + 1):
            column = wp.clamp(x + i, 0, width - 1)
            # Apart from the column, so that a part of a picture rounds as the whole of it.
            shift = direction * (surface + along_x * float(i))
            whole = wp.floor(shift)
            share = shift - whole
            u = column + int(whole)
            seen = other[row + wp.clamp(u, 0, width - 1)] * (1.0 - share)
            seen += other[row + wp.clamp(u + 1, 0, width - 1)] * share
            left = reference[row + column] - seen
            total += left
            squares += left * left
    mean = total * WINDOW_SHARE
    return wp.max(squares * WINDOW_SHARE - mean * mean, 0.0)


@wp.kernel
def flat(
    # In:
    reference: wp.array(dtype=float),
    other: wp.array(dtype=float),
    planes: wp.array(dtype=float),
    disparity: wp.array(dtype=float),
    agreement: wp.array(dtype=float),
    width: int,
    height: int,
    planes_wide: int,
    planes_high: int,
    pitch: int,
    direction: int,
    noise: float,
    least_agreement: float,
    least_share: float,
    # Out:
    plane_out: wp.array(dtype=float),
    along_x_out: wp.array(dtype=float),
    along_y_out: wp.array(dtype=float),
    wanted_out: wp.array(dtype=wp.uint8),
):
    """Tell the plane at each pixel, its slopes, and whether it is wanted there.

    Planes stand pitch px apart: (4, planes_high, planes_wide) values at their centre, NaN where there is none, slopes
    along x and y, and the share of what lies around that agrees with them. Those of the four centres around a pixel
    are mixed, by distance and share. A plane is wanted where all of this holds: the views agree about less than
    least_agreement of the surroundings, the planes' share is more than least_share, and over a window of 5 x 5 pixels
    the plane explains the pictures about as well as the disparity does, and well at all. What counts is the variance of
    what is left of their difference, so that a difference in brightness changes nothing; noise is that of the pictures'
    noise. plane_out is NaN and slopes are 0 where there is no plane.
    """
    y, x = wp.tid()
    pixel = y * width + x
    before = centre_before(x, pitch)
    past = halves_from(x, before, pitch)
    first = wp.clamp(before, 0, planes_wide - 1)
    second = wp.clamp(before + 1, 0, planes_wide - 1)
    left = column_at(planes, first, y, planes_wide, planes_high, pitch)
    right = column_at(planes, second, y, planes_wide, planes_high, pitch)
    right_weight = float(past)
    left_weight = float(2 * pitch - past)
    weight = left_weight * left[0] + right_weight * right[0]
    if not (weight > 0.0):
        plane_out[pixel] = wp.nan
        along_x_out[pixel] = 0.0
        along_y_out[pixel] = 0.0
        wanted_out[pixel] = wp.uint8(0)
        return
    one = 1.0 / weight
    plane = left_weight * (left[1] + left[2] * (0.5 * float(halves_from(x, first, pitch))))
    plane += right_weight * (right[1] + right[2] * (0.5 * float(halves_from(x, second, pitch))))
    plane *= one
    along_x = (left_weight * left[2] + right_weight * right[2]) * one
    along_y = (left_weight * left[3] + right_weight * right[3]) * one
    share = (left_weight * left[4] + right_weight * right[4]) * one
    way = float(direction)
    wanted = agreement[pixel] < least_agreement and share > least_share
    if wanted:
        mine = unexplained(reference, other, x, y, width, height, way, plane, along_x, along_y)
        u = float(x) + way * plane
        given = disparity[pixel]
        wanted = mine <= MOST * noise or u < 0.0 or u > float(width - 1)
        if wanted and not wp.isnan(given):
            theirs = unexplained(reference, other, x, y, width, height, way, given, 0.0, 0.0)
            wanted = mine <= theirs + WORSE * noise
    plane_out[pixel] = plane
    along_x_out[pixel] = along_x
    along_y_out[pixel] = along_y
    wanted_out[pixel] = wp.uint8(wp.where(wanted, 1, 0))
