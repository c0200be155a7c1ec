"""Disparity to points in space: the form for CPUs, whose work-items take a row each."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def triangulate(
    # In:
    disparity: wp.array(dtype=float),
    width: int,
    height: int,
    direction: int,
    focal_px: float,
    baseline: float,
    cx_left: float,
    cx_right: float,
    cy: float,
    # Out:
    points_out: wp.array(dtype=float),
):
    """Point (x, y, z) of every pixel in the baseline's unit, frame of the rectified left camera.

    NaN where there is no disparity, or none that lies in front of the cameras. direction is 1 where the map
    is laid out on the right view and -1 for the left one.
    """
    y = wp.tid()
    # Arrays whose elements are known to lie side by side are faster to read and write.
    given = wp.array(ptr=disparity.ptr, shape=(1,), dtype=float)
    points = wp.array(ptr=points_out.ptr, shape=(1,), dtype=float)
    down = float(y) - cy
    x = int(0)
    while x < width:
        value = given[y * width + x]
        at = (y * width + x) * 3
        parallax = value - (cx_left - cx_right)
        scale = wp.where(parallax > 0.0, baseline / parallax, wp.nan)
        x_left = float(x)
        if direction > 0:
            x_left += value
        points[at] = (x_left - cx_left) * scale
        points[at + 1] = down * scale
        points[at + 2] = focal_px * scale
        x += 1
