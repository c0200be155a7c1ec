"""How far a disparity is to be trusted."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def confidence(
    # In:
    score: wp.array(dtype=float),
    ratio: wp.array(dtype=float),
    validity: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    weight: float,
    # Out:
    confidence_out: wp.array(dtype=float),
):
    """The score within 0..1, less the closer the runner-up comes to it, by weight; 0 where the pixel is not good."""
    y, x = wp.tid()
    pixel = y * width + x
    trusted = wp.clamp(score[pixel] * (1.0 - weight * ratio[pixel]), 0.0, 1.0)
    confidence_out[pixel] = wp.where(validity[pixel] == wp.uint8(0), trusted, 0.0)
