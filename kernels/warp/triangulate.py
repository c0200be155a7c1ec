"""Disparity to points in space."""

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
    y, x = wp.tid()
    pixel = y * width + x
    value = disparity[pixel]
    points_out[pixel * 3] = wp.nan
    points_out[pixel * 3 + 1] = wp.nan
    points_out[pixel * 3 + 2] = wp.nan
    parallax = value - (cx_left - cx_right)
    if parallax > 0.0:
        x_left = float(x)
        if direction > 0:
            x_left += value
        scale = baseline / parallax
        points_out[pixel * 3] = (x_left - cx_left) * scale
        points_out[pixel * 3 + 1] = (float(y) - cy) * scale
        points_out[pixel * 3 + 2] = focal_px * scale
