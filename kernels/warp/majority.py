"""Take planes where most of the surroundings want them."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def majority(
    # In:
    wanted: wp.array(dtype=wp.uint8),
    plane: wp.array(dtype=float),
    disparity: wp.array(dtype=float),
    width: int,
    height: int,
    radius: int,
    # Out:
    disparity_out: wp.array(dtype=float),
    taken_out: wp.array(dtype=wp.uint8),
):
    """Take a pixel's plane, where it has one, if at least half of the (2 radius + 1)^2 pixels around want theirs.

    Pixels outside of the picture do not count.
    """
    y, x = wp.tid()
    top = wp.max(y - radius, 0)
    bottom = wp.min(y + radius + 1, height)
    left = wp.max(x - radius, 0)
    right = wp.min(x + radius + 1, width)
    count = int(0)
    for j in range(top, bottom):
        for p in range(j * width + left, j * width + right):
            if int(wanted[p]) != 0:
                count += 1
    pixel = y * width + x
    if 2 * count >= (bottom - top) * (right - left) and not wp.isnan(plane[pixel]):
        disparity_out[pixel] = plane[pixel]
        taken_out[pixel] = wp.uint8(1)
    else:
        disparity_out[pixel] = disparity[pixel]
        taken_out[pixel] = wp.uint8(0)
