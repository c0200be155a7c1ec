"""How the surfaces of a disparity map lean."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

SAME_SLOPE = wp.constant(0.5)  # px a pixel by which the two sides of one surface differ at most


@wp.func
def slope(centre: float, before: float, after: float, reach: int, largest: float) -> float:
    """The mean of both sides, or the gentler one where they differ; 0 above `largest` or without any side."""
    back = (centre - before) / float(reach)
    ahead = (after - centre) / float(reach)
    found = wp.where(wp.abs(ahead) < wp.abs(back), ahead, back)
    if wp.abs(ahead - back) <= SAME_SLOPE:
        found = 0.5 * (ahead + back)
    if wp.isnan(ahead):
        found = back
    if wp.isnan(back):
        found = ahead
    return wp.where(wp.abs(found) <= largest, found, 0.0)


@wp.kernel
def slopes(
    # In:
    disparity: wp.array(dtype=float),
    width: int,
    height: int,
    reach: int,
    largest: float,
    # Out:
    along_x_out: wp.array(dtype=float),
    along_y_out: wp.array(dtype=float),
):
    """Change of the disparity a pixel, along x and along y.

    Differences over `reach` pixels to either side, the mean of both or of the gentler one where they differ by more
    than SAME_SLOPE. A side outside of the picture or without a value does not count. A slope of more than `largest`
    px a pixel is a depth jump, and 0, as where there is no side.
    """
    y, x = wp.tid()
    pixel = y * width + x
    left = float(wp.nan)
    right = float(wp.nan)
    above = float(wp.nan)
    below = float(wp.nan)
    if x >= reach:
        left = disparity[pixel - reach]
    if x + reach < width:
        right = disparity[pixel + reach]
    if y >= reach:
        above = disparity[pixel - reach * width]
    if y + reach < height:
        below = disparity[pixel + reach * width]
    along_x_out[pixel] = slope(disparity[pixel], left, right, reach, largest)
    along_y_out[pixel] = slope(disparity[pixel], above, below, reach, largest)
