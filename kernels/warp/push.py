"""Gaps of a picture filled from its next coarser level."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def push(
    # In:
    coarse: wp.array(dtype=wp.uint16),
    coarse_width: int,
    width: int,
    height: int,
    # Out:
    fine_out: wp.array(dtype=wp.uint16),
):
    """A texel that is not there (its fourth number is 0) becomes the coarser level's texel that it lies in.

    (Gortler et al., "The Lumigraph", SIGGRAPH 1996, section 3.4.3: push.)
    """
    y, x = wp.tid()
    to = (y * width + x) * 4
    if fine_out[to + 3] == wp.uint16(0):
        at = ((y // 2) * coarse_width + x // 2) * 4
        for k in range(4):
            fine_out[to + k] = coarse[at + k]
