"""Samples between pixels by Catmull and Rom's cubic (R. Keys, "Cubic Convolution Interpolation", 1981).

It gives a pixel's own value at its centre.
"""

import warp as wp

from stereo_gpu.kernels.warp.light import light_at

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def cubic_shares(t: float) -> wp.vec4:
    """Shares of the pixels at -1, 0, 1 and 2 of a sample at t from 0 to 1."""
    return wp.vec4(
        ((-0.5 * t + 1.0) * t - 0.5) * t,
        (1.5 * t - 2.5) * t * t + 1.0,
        ((-1.5 * t + 2.0) * t + 0.5) * t,
        (0.5 * t - 0.5) * t * t,
    )


@wp.func
def sample_cubic(light: wp.array(dtype=wp.uint16), width: int, height: int, u: float, v: float) -> wp.vec4:
    """Value at column u, row v (pixel centres at whole numbers), the picture's edge repeated."""
    x = int(wp.floor(u))
    y = int(wp.floor(v))
    across = cubic_shares(u - float(x))
    down = cubic_shares(v - float(y))
    result = wp.vec4(0.0, 0.0, 0.0, 0.0)
    for i in range(4):
        column = wp.clamp(x + i - 1, 0, width - 1)
        sum = wp.vec4(0.0, 0.0, 0.0, 0.0)
        for j in range(4):
            sum += light_at(light, wp.clamp(y + j - 1, 0, height - 1) * width + column) * down[j]
        result += sum * across[i]
    return result
