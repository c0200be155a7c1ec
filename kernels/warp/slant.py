"""Refine disparities by correlating windows that lean with the surface."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

SLOPE_REACH = wp.constant(6)
FIT_REACH = wp.constant(3)
FIT_STEP = wp.constant(2)
FIT_ENOUGH = wp.constant(12.0)
SAME_SLOPE = wp.constant(0.5)
SAME_SURFACE = wp.constant(1.0)
SURE = wp.constant(0.7)


@wp.func
def slope(disparity: wp.array(dtype=float), start: int, at: int, size: int, stride: int, largest: float) -> float:
    """Disparity change a pixel along one axis: the mean of both sides, or of the gentler one where they differ.

    A side that leaves the picture, has no value or rises by more than largest px a pixel does not count.
    """
    centre = disparity[start + at * stride]
    back = float(wp.nan)
    ahead = float(wp.nan)
    if at >= SLOPE_REACH:
        back = (centre - disparity[start + (at - SLOPE_REACH) * stride]) / float(SLOPE_REACH)
    if at + SLOPE_REACH < size:
        ahead = (disparity[start + (at + SLOPE_REACH) * stride] - centre) / float(SLOPE_REACH)
    good_back = wp.abs(back) <= largest
    good_ahead = wp.abs(ahead) <= largest
    if good_back and good_ahead:
        if wp.abs(ahead - back) <= SAME_SLOPE:
            return 0.5 * (ahead + back)
        return wp.where(wp.abs(ahead) < wp.abs(back), ahead, back)
    if good_back:
        return back
    if good_ahead:
        return ahead
    return 0.0


@wp.func
def fit_plane(
    disparity: wp.array(dtype=float), x: int, y: int, along_x: float, along_y: float, width: int, height: int
) -> wp.vec3:
    """Disparity at (x, y) and slopes of the least squares plane through the pixels around that lie near one.

    Near the plane through (x, y) with slopes along_x and along_y; that plane itself where too few do.
    """
    centre = disparity[y * width + x]
    n = float(0.0)
    sum_x = float(0.0)
    sum_y = float(0.0)
    sum_v = float(0.0)
    sum_xx = float(0.0)
    sum_xy = float(0.0)
    sum_yy = float(0.0)
    sum_xv = float(0.0)
    sum_yv = float(0.0)
    for j in range(-FIT_REACH, FIT_REACH + 1):
        for i in range(-FIT_REACH, FIT_REACH + 1):
            row = y + j * FIT_STEP
            column = x + i * FIT_STEP
            if row >= 0 and row < height and column >= 0 and column < width:
                dx = float(i * FIT_STEP)
                dy = float(j * FIT_STEP)
                v = disparity[row * width + column] - centre
                if wp.abs(v - along_x * dx - along_y * dy) <= SAME_SURFACE:
                    n += 1.0
                    sum_x += dx
                    sum_y += dy
                    sum_v += v
                    sum_xx += dx * dx
                    sum_xy += dx * dy
                    sum_yy += dy * dy
                    sum_xv += dx * v
                    sum_yv += dy * v
    plane = wp.vec3(centre, along_x, along_y)
    if n >= FIT_ENOUGH:
        xx = sum_xx - sum_x * sum_x / n
        xy = sum_xy - sum_x * sum_y / n
        yy = sum_yy - sum_y * sum_y / n
        xv = sum_xv - sum_x * sum_v / n
        yv = sum_yv - sum_y * sum_v / n
        area = xx * yy - xy * xy
        # Pixels on one line tell no slope across it.
        if area > n * n:
            slope_x = (xv * yy - yv * xy) / area
            slope_y = (yv * xx - xv * xy) / area
            plane = wp.vec3(centre + (sum_v - slope_x * sum_x - slope_y * sum_y) / n, slope_x, slope_y)
    return plane


@wp.func
def leaning_ncc(
    reference: wp.array(dtype=float),
    other: wp.array(dtype=float),
    disparity: wp.array(dtype=float),
    x: int,
    y: int,
    plane: wp.vec3,
    shift: float,
    width: int,
    height: int,
    radius: int,
    direction: float,
) -> float:
    """NCC of the pixels around (x, y) that lie on a plane of disparity, with the plane moved by shift px.

    Pixels whose own disparity is further than SAME_SURFACE from the plane belong to another surface. 0 where
    the window is flat or holds less than a third of its pixels: a handful correlates with anything.
    """
    count = float(0.0)
    sum_a = float(0.0)
    sum_b = float(0.0)
    sum_aa = float(0.0)
    sum_bb = float(0.0)
    sum_ab = float(0.0)
    for j in range(-radius, radius + 1):
        row = wp.clamp(y + j, 0, height - 1) * width
        for i in range(-radius, radius + 1):
            at = row + wp.clamp(x + i, 0, width - 1)
            surface = plane[0] + plane[1] * float(i) + plane[2] * float(j)
            if wp.abs(disparity[at] - surface) <= SAME_SURFACE:
                a = reference[at]
                # Counted from x, so that a part of a picture rounds as the whole of it.
                u = float(i) + direction * (surface + shift)
                left = wp.floor(u)
                share = u - left
                column = x + int(left)
                b = other[row + wp.clamp(column, 0, width - 1)] * (1.0 - share)
                b += other[row + wp.clamp(column + 1, 0, width - 1)] * share
                count += 1.0
                sum_a += a
                sum_b += b
                sum_aa += a * a
                sum_bb += b * b
                sum_ab += a * b
    energy = (sum_aa - sum_a * sum_a / count) * (sum_bb - sum_b * sum_b / count)
    window = float((2 * radius + 1) * (2 * radius + 1))
    if energy <= 1.0 or count * 3.0 < window:
        return 0.0
    return (sum_ab - sum_a * sum_b / count) / wp.sqrt(energy)


@wp.func
def step_to_peak(below: float, here: float, above: float) -> wp.vec2:
    """Where three scores one step apart peak, in steps from the middle, and the score there; not under SURE."""
    moved = float(0.0)
    best = here
    if here >= below and here >= above:
        bend = (below - here) + (above - here)
        if bend < 0.0:
            moved = 0.5 * (below - above) / bend
    elif below >= above:
        moved = -1.0
        best = below
    else:
        moved = 1.0
        best = above
    if best < SURE:
        moved = 0.0
        best = here
    return wp.vec2(moved, best)


# Half of a multiprocessor's threads at least; Warp's loop over the grid would take registers for its counters.
@wp.kernel(launch_bounds=(256, 4), grid_stride=False)
def slant(
    # In:
    reference: wp.array(dtype=float),
    other: wp.array(dtype=float),
    disparity: wp.array(dtype=float),
    width: int,
    height: int,
    radius: int,
    direction: int,
    step: float,
    largest_slope: float,
    # Out:
    disparity_out: wp.array(dtype=float),
    score_out: wp.array(dtype=float),
):
    """Move each disparity to the peak of the NCC over step px around it, with windows that follow the surface.

    The window leans with the plane through the map around it; a slope of more than largest_slope px a pixel is
    a depth jump. The peak is a parabola's through three scores, at most step px from the plane. score_out is
    the NCC there; where it is under SURE noise would decide, and the plane stands.
    """
    y, x = wp.tid()
    pixel = y * width + x
    value = disparity[pixel]
    disparity_out[pixel] = value
    score_out[pixel] = 0.0
    if wp.isnan(value):
        return
    along_x = slope(disparity, y * width, x, width, 1, largest_slope)
    along_y = slope(disparity, x, y, height, width, largest_slope)
    plane = fit_plane(disparity, x, y, along_x, along_y, width, height)
    way = float(direction)
    here = leaning_ncc(reference, other, disparity, x, y, plane, 0.0, width, height, radius, way)
    below = leaning_ncc(reference, other, disparity, x, y, plane, -step, width, height, radius, way)
    above = leaning_ncc(reference, other, disparity, x, y, plane, step, width, height, radius, way)
    peak = step_to_peak(below, here, above)
    disparity_out[pixel] = plane[0] + peak[0] * step
    score_out[pixel] = wp.max(peak[1], 0.0)
