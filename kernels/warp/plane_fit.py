"""Move disparities onto the plane through those surroundings that look alike."""

import warp as wp

from stereo_gpu.kernels.warp.likeness import MASKED, furthest, neighbour_weight

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FIT_ENOUGH = wp.constant(3.0)  # sum of weights; fewer neighbours tell no plane
FIT_STIFF = wp.constant(0.5)  # pulls the slopes towards 0, in squared px: neighbours on a line tell no slope across it


@wp.func
def solve(
    plane: wp.vec3,
    n: float,
    sum_x: float,
    sum_y: float,
    sum_v: float,
    sum_xx: float,
    sum_xy: float,
    sum_yy: float,
    sum_xv: float,
    sum_yv: float,
    largest_slope: float,
) -> wp.vec4:
    """The plane that weighted sums tell, and 1; the given one, and 0, where the weights are too few."""
    same = wp.vec4(plane[0], plane[1], plane[2], 0.0)
    if not (n >= FIT_ENOUGH):
        return same
    one = 1.0 / n
    mean_x = sum_x * one
    mean_y = sum_y * one
    stiff = FIT_STIFF * n
    xx = sum_xx - sum_x * mean_x + stiff
    yy = sum_yy - sum_y * mean_y + stiff
    xy = sum_xy - sum_x * mean_y
    xv = sum_xv - sum_v * mean_x
    yv = sum_yv - sum_v * mean_y
    area = xx * yy - xy * xy
    if not (area > 0.0):
        return same
    along_x = (xv * yy - yv * xy) / area
    along_y = (yv * xx - xv * xy) / area
    along_x = wp.where(wp.abs(along_x) <= largest_slope, along_x, 0.0)
    along_y = wp.where(wp.abs(along_y) <= largest_slope, along_y, 0.0)
    return wp.vec4(sum_v * one - along_x * mean_x - along_y * mean_y, along_x, along_y, 1.0)


@wp.func
def fit_again(
    plane: wp.vec3,
    disparity: wp.array(dtype=float),
    validity: wp.array(dtype=wp.uint8),
    guide: wp.array(dtype=wp.uint8),
    x: int,
    y: int,
    width: int,
    height: int,
    reach: int,
    step: int,
    tolerance: float,
    slope: float,
    largest_slope: float,
) -> wp.vec4:
    """Least squares plane through the neighbours near the given one; the weight falls to 0 at the tolerance.

    A plane is a disparity relative to the pixel's own, and slopes. Rows are summed up first, each from left to right.
    The last number returned is 0, and the plane the given one, where too few neighbours are near.
    """
    pixel = y * width + x
    half_way = reach // step
    n = float(0.0)
    sum_x = float(0.0)
    sum_y = float(0.0)
    sum_v = float(0.0)
    sum_xx = float(0.0)
    sum_xy = float(0.0)
    sum_yy = float(0.0)
    sum_xv = float(0.0)
    sum_yv = float(0.0)
    for j in range(-half_way, half_way + 1):
        row = y + j * step
        if row >= 0 and row < height:
            dy = float(j * step)
            surface = plane[0] + plane[2] * dy
            row_n = float(0.0)
            row_x = float(0.0)
            row_v = float(0.0)
            for i in range(-half_way, half_way + 1):
                column = x + i * step
                if column >= 0 and column < width:
                    dx = float(i * step)
                    v = disparity[row * width + column] - disparity[pixel]
                    off = v - surface - plane[1] * dx
                    allowed = tolerance + slope * float(furthest(i * step, j * step))
                    near = 1.0 - off * off * (1.0 / (allowed * allowed))
                    if near > 0.0:
                        weight = neighbour_weight(guide, validity, width * height, pixel, row * width + column)
                        weight *= near * near
                        weighted_x = weight * dx
                        weighted_v = weight * v
                        row_n += weight
                        row_x += weighted_x
                        row_v += weighted_v
                        sum_xx += weighted_x * dx
                        sum_xv += weighted_v * dx
            n += row_n
            sum_x += row_x
            sum_v += row_v
            sum_y += row_n * dy
            sum_xy += row_x * dy
            sum_yy += row_n * (dy * dy)
            sum_yv += row_v * dy
    return solve(plane, n, sum_x, sum_y, sum_v, sum_xx, sum_xy, sum_yy, sum_xv, sum_yv, largest_slope)


# Half of a multiprocessor's threads at least; Warp's loop over the grid would take registers for its counters.
@wp.kernel(launch_bounds=(256, 4), grid_stride=False)
def plane_fit(
    # In:
    disparity: wp.array(dtype=float),
    validity: wp.array(dtype=wp.uint8),
    guide: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    reach: int,
    step: int,
    tolerance: float,
    slope: float,
    largest_slope: float,
    # Out:
    disparity_out: wp.array(dtype=float),
):
    """Least squares plane through the pixels around each (within reach, every step-th), in two rounds.

    Through those within tolerance px of the pixel's own disparity, where the tolerance grows by slope px with each
    row or column of distance, then through those within tolerance of that plane. Neighbours weigh by how near they
    are to it (Tukey 1977) and by how much they look like the pixel in the guide, three planes of bytes; masked ones
    not at all. A slope of more than largest_slope px a pixel is a depth jump. No disparity moves by more than
    tolerance.
    """
    y, x = wp.tid()
    pixel = y * width + x
    value = disparity[pixel]
    disparity_out[pixel] = value
    if wp.isnan(value) or (int(validity[pixel]) & MASKED) != 0:
        return
    plane = wp.vec4(0.0, 0.0, 0.0, 1.0)
    grows = slope
    for _ in range(2):
        if plane[3] > 0.0:
            given = wp.vec3(plane[0], plane[1], plane[2])
            plane = fit_again(
                given, disparity, validity, guide, x, y, width, height, reach, step, tolerance, grows, largest_slope
            )
        grows = 0.0
    if wp.abs(plane[0]) <= tolerance:
        disparity_out[pixel] = value + plane[0]
