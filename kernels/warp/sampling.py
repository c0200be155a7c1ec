"""Bilinear samples of a picture of any pixel type."""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def sample(
    picture: wp.array(dtype=Any), width: int, height: int, channels: int, channel: int, u: float, v: float
) -> float:
    """Bilinear value at column u, row v (pixel centres at whole numbers), the picture's edge repeated."""
    x = int(wp.floor(u))
    y = int(wp.floor(v))
    across = u - float(x)
    down = v - float(y)
    left = wp.clamp(x, 0, width - 1)
    right = wp.clamp(x + 1, 0, width - 1)
    top = wp.clamp(y, 0, height - 1) * width
    bottom = wp.clamp(y + 1, 0, height - 1) * width
    upper = float(picture[(top + left) * channels + channel]) * (1.0 - across)
    upper += float(picture[(top + right) * channels + channel]) * across
    lower = float(picture[(bottom + left) * channels + channel]) * (1.0 - across)
    lower += float(picture[(bottom + right) * channels + channel]) * across
    return upper * (1.0 - down) + lower * down
