"""How likely a disparity of smooth paths is right."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def certainty(
    # In:
    ratio: wp.array(dtype=float),
    validity: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    doubt: float,
    # Out:
    confidence_out: wp.array(dtype=float),
):
    """About the probability that a disparity found by smooth paths is right to 1 px; 0 where the pixel is not good.

    It falls with the cube of the ratio of the lowest sum of costs to the runner-up's, by `doubt` where both are equal.
    """
    y, x = wp.tid()
    pixel = y * width + x
    rival = float(1.0)
    if ratio[pixel] < 1.0:
        rival = ratio[pixel]
    trusted = 1.0 - doubt * (rival * rival * rival)
    confidence_out[pixel] = wp.where(validity[pixel] == wp.uint8(0), trusted, 0.0)
