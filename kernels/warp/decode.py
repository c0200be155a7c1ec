"""A picture's levels as linear light."""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def decode(
    # In:
    picture: wp.array(dtype=Any),
    valid: wp.array(dtype=wp.uint8),
    table: wp.array(dtype=wp.uint16),
    width: int,
    height: int,
    channels: int,
    # Out:
    light_out: wp.array(dtype=wp.uint16),
):
    """Light of every valid pixel, 16 bits each of red, green, blue and 65535: what the table says of its levels.

    Levels must not be more than it has entries; a grey picture has the same in all three. 0 where a pixel is not valid.
    """
    y, x = wp.tid()
    pixel = y * width + x
    for channel in range(4):
        light_out[pixel * 4 + channel] = wp.uint16(0)
    if valid[pixel] != wp.uint8(0):
        for channel in range(3):
            light_out[pixel * 4 + channel] = table[int(picture[pixel * channels + wp.min(channel, channels - 1)])]
        light_out[pixel * 4 + 3] = wp.uint16(65535)
