"""Leave out what was only filled in."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FILLED = wp.constant(wp.uint8(32))


@wp.kernel
def unfilled(
    # In:
    disparity: wp.array(dtype=float),
    validity: wp.array(dtype=wp.uint8),
    taken: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    # Out:
    disparity_out: wp.array(dtype=float),
):
    """The disparity, NaN where it was filled in and nothing sure has taken its place (taken is 0)."""
    y, x = wp.tid()
    pixel = y * width + x
    guessed = (validity[pixel] & FILLED) != wp.uint8(0) and taken[pixel] == wp.uint8(0)
    disparity_out[pixel] = wp.where(guessed, wp.nan, disparity[pixel])
