"""Which pixels of a view are not to be matched."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

MASKED = wp.constant(wp.uint8(16))


@wp.kernel
def masked(
    # In:
    mask: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    # Out:
    validity_out: wp.array(dtype=wp.uint8),
):
    """MASKED where the mask is 0, else 0."""
    y, x = wp.tid()
    pixel = y * width + x
    validity_out[pixel] = wp.where(mask[pixel] == wp.uint8(0), MASKED, wp.uint8(0))
