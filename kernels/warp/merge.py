"""Of two disparity maps, the one whose surroundings cost less."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def merge(
    # In:
    disparity: wp.array(dtype=float),
    lowest: wp.array(dtype=float),
    validity: wp.array(dtype=wp.uint8),
    ratio: wp.array(dtype=float),
    rival_disparity: wp.array(dtype=float),
    rival_lowest: wp.array(dtype=float),
    rival_validity: wp.array(dtype=wp.uint8),
    rival_ratio: wp.array(dtype=float),
    width: int,
    height: int,
    radius: int,
    margin: float,
    # Out:
    disparity_out: wp.array(dtype=float),
    lowest_out: wp.array(dtype=float),
    validity_out: wp.array(dtype=wp.uint8),
    ratio_out: wp.array(dtype=float),
):
    """Take the rival where the mean of lowest - rival_lowest exceeds margin over the (2 radius + 1)^2 pixels around.

    Pixels where either map has no value, or outside of the picture, do not count. Where one map has no value, the
    other is taken. lowest and rival_lowest are whole numbers, whose sums are exact in any order below 2^24.
    """
    y, x = wp.tid()
    pixel = y * width + x
    gain = float(0.0)
    count = float(0.0)
    for j in range(wp.max(y - radius, 0), wp.min(y + radius + 1, height)):
        for i in range(wp.max(x - radius, 0), wp.min(x + radius + 1, width)):
            p = j * width + i
            if not wp.isnan(disparity[p]) and not wp.isnan(rival_disparity[p]):
                gain += lowest[p] - rival_lowest[p]
                count += 1.0
    if not wp.isnan(rival_disparity[pixel]) and (wp.isnan(disparity[pixel]) or gain > margin * count):
        disparity_out[pixel] = rival_disparity[pixel]
        lowest_out[pixel] = rival_lowest[pixel]
        validity_out[pixel] = rival_validity[pixel]
        ratio_out[pixel] = rival_ratio[pixel]
    else:
        disparity_out[pixel] = disparity[pixel]
        lowest_out[pixel] = lowest[pixel]
        validity_out[pixel] = validity[pixel]
        ratio_out[pixel] = ratio[pixel]
