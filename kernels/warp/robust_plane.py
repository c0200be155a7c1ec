"""A plane through the cells around it that are not led astray by those of other surfaces."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FITS = wp.constant(4)  # the first one takes all cells alike, then those far off the plane weigh ever less
WIDEST_SCALE = wp.constant(4.0)  # px: of the second fit; half of it with each further one (graduated non-convexity)
FIT_ENOUGH = wp.constant(1.0e-6)  # sum of weights: less tells no plane
FIT_STIFF = wp.constant(0.25)  # pulls the slopes towards 0, in squared cells: cells on a line tell none across it
STEEPEST = wp.constant(1.0)  # slope, px a pixel


@wp.func
def solve(
    value: float,
    n: float,
    sum_x: float,
    sum_y: float,
    sum_v: float,
    sum_xx: float,
    sum_xy: float,
    sum_yy: float,
    sum_xv: float,
    sum_yv: float,
    stiff: float,
) -> wp.vec3:
    """Value and slopes that the weighted sums tell, whose disparities are relative to `value`."""
    one = 1.0 / n
    mean_x = sum_x * one
    mean_y = sum_y * one
    xx = sum_xx - sum_x * mean_x + stiff * n
    yy = sum_yy - sum_y * mean_y + stiff * n
    xy = sum_xy - sum_x * mean_y
    xv = sum_xv - sum_v * mean_x
    yv = sum_yv - sum_v * mean_y
    area = xx * yy - xy * xy
    along_x = wp.clamp((xv * yy - yv * xy) / area, -STEEPEST, STEEPEST)
    along_y = wp.clamp((yv * xx - xv * xy) / area, -STEEPEST, STEEPEST)
    return wp.vec3(value + (sum_v * one - along_x * mean_x - along_y * mean_y), along_x, along_y)
