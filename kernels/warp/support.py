"""Drop disparities that their surroundings do not share."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

MISMATCH = wp.constant(8)


@wp.kernel
def support(
    # In:
    disparity: wp.array(dtype=float),
    validity: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    reach: int,
    step: int,
    tolerance: float,
    slope: float,
    share: float,
    # Out:
    disparity_out: wp.array(dtype=float),
    validity_out: wp.array(dtype=wp.uint8),
):
    """Keep a value that at least share of the pixels around it (within reach, every step-th) have, to tolerance px.

    A surface may lean: the tolerance grows by slope px with each row or column of distance.

    Pixels outside the picture or without a value do not share it.
    """
    y, x = wp.tid()
    pixel = y * width + x
    value = disparity[pixel]
    disparity_out[pixel] = value
    validity_out[pixel] = validity[pixel]
    if wp.isnan(value):
        return
    across = 2 * (reach // step) + 1
    agreeing = int(0)
    for k in range(across * across):
        row = y + (k // across - reach // step) * step
        column = x + (k % across - reach // step) * step
        if row >= 0 and row < height and column >= 0 and column < width:
            distance = float(wp.max(wp.abs(row - y), wp.abs(column - x)))
            if wp.abs(disparity[row * width + column] - value) <= tolerance + slope * distance:
                agreeing += 1
    if float(agreeing) < share * float(across * across):
        disparity_out[pixel] = wp.nan
        validity_out[pixel] = wp.uint8(MISMATCH)
