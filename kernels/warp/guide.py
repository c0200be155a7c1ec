"""Colour of a picture in levels that the camera's gain and offset do not change: what tells where depth may jump."""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def guide(
    # In:
    picture: wp.array(dtype=Any),
    levels: wp.array(dtype=float),
    width: int,
    height: int,
    channels: int,
    # Out:
    guide_out: wp.array(dtype=wp.uint8),
):
    """floor(value gain + offset + 0.5), 0..255, of three planes, (3, H, W); a grey picture gives three equal ones.

    levels holds gain and offset of each plane.
    """
    y, x = wp.tid()
    pixel = y * width + x
    for c in range(3):
        value = float(picture[wp.where(channels == 1, pixel, pixel * channels + c)])
        level = value * levels[2 * c] + levels[2 * c + 1] + 0.5
        guide_out[c * width * height + pixel] = wp.uint8(int(wp.clamp(level, 0.0, 255.0)))
