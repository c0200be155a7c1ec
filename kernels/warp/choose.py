"""Of the maps of two windows, the smaller one's wherever it has a value."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def choose(
    # In:
    disparity: wp.array(dtype=float),
    score: wp.array(dtype=float),
    ratio: wp.array(dtype=float),
    validity: wp.array(dtype=wp.uint8),
    wider_disparity: wp.array(dtype=float),
    wider_score: wp.array(dtype=float),
    wider_ratio: wp.array(dtype=float),
    wider_validity: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    # Out:
    disparity_out: wp.array(dtype=float),
    score_out: wp.array(dtype=float),
    ratio_out: wp.array(dtype=float),
    validity_out: wp.array(dtype=wp.uint8),
):
    """Take the wider window's disparity, score, ratio and reason where the smaller window has no disparity."""
    y, x = wp.tid()
    pixel = y * width + x
    if wp.isnan(disparity[pixel]):
        disparity_out[pixel] = wider_disparity[pixel]
        score_out[pixel] = wider_score[pixel]
        ratio_out[pixel] = wider_ratio[pixel]
        validity_out[pixel] = wider_validity[pixel]
    else:
        disparity_out[pixel] = disparity[pixel]
        score_out[pixel] = score[pixel]
        ratio_out[pixel] = ratio[pixel]
        validity_out[pixel] = validity[pixel]
