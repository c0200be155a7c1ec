"""Luma of a picture, centred and in whole steps: what the matching kernels read."""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def grey(
    # In:
    picture: wp.array(dtype=Any),
    width: int,
    height: int,
    channels: int,
    black: float,
    scale: float,
    # Out:
    grey_out: wp.array(dtype=float),
):
    """Rec. 601 luma above black, times scale, rounded to whole grey levels 0..255, minus 128."""
    y, x = wp.tid()
    pixel = y * width + x
    luma = float(0.0)
    if channels == 1:
        luma = float(picture[pixel])
    else:
        red = float(picture[pixel * channels])
        green = float(picture[pixel * channels + 1])
        blue = float(picture[pixel * channels + 2])
        luma = 0.299 * red + 0.587 * green + 0.114 * blue
    # Whole numbers keep every sum of products of the correlation exact in float32.
    grey_out[pixel] = wp.floor(wp.clamp((luma - black) * scale, 0.0, 255.0) + 0.5) - 128.0
