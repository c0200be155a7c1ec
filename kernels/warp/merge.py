"""The better of two disparity maps at every pixel."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def merge(
    # In:
    disparity: wp.array(dtype=float),
    score: wp.array(dtype=float),
    validity: wp.array(dtype=wp.uint8),
    rival_disparity: wp.array(dtype=float),
    rival_score: wp.array(dtype=float),
    rival_validity: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    margin: float,
    # Out:
    disparity_out: wp.array(dtype=float),
    score_out: wp.array(dtype=float),
    validity_out: wp.array(dtype=wp.uint8),
):
    """Take the rival where it has a value and the other has none, or scores less by more than margin."""
    y, x = wp.tid()
    pixel = y * width + x
    disparity_out[pixel] = disparity[pixel]
    score_out[pixel] = score[pixel]
    validity_out[pixel] = validity[pixel]
    if wp.isnan(rival_disparity[pixel]):
        return
    if wp.isnan(disparity[pixel]) or rival_score[pixel] > score[pixel] + margin:
        disparity_out[pixel] = rival_disparity[pixel]
        score_out[pixel] = rival_score[pixel]
        validity_out[pixel] = rival_validity[pixel]
