"""Resample a picture into a texture atlas."""

from typing import Any

import warp as wp

from stereo_gpu.kernels.warp.cover import weights
from stereo_gpu.kernels.warp.sampling import sample

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def bake(
    # In:
    picture: wp.array(dtype=Any),
    corners: wp.array(dtype=float),
    owner: wp.array(dtype=int),
    width: int,
    height: int,
    channels: int,
    scale: float,
    texture_width: int,
    texture_height: int,
    # Out:
    texture_out: wp.array(dtype=wp.uint8),
    covered_out: wp.array(dtype=wp.uint8),
):
    """Colour of every texel that a triangle owns, and 1 in covered_out; 0 elsewhere.

    corners is (F, 3, 5): a corner's place in the atlas in texels, and u z, v z, z of its pixel (u, v) in the
    picture, so that perspective stays exact inside of a triangle. scale takes the picture's values to 0..255.
    """
    y, x = wp.tid()
    texel = y * texture_width + x
    face = owner[texel] - 1
    covered_out[texel] = wp.uint8(wp.min(owner[texel], 1))
    u = float(0.0)
    v = float(0.0)
    if face >= 0:
        at = face * 15
        share = weights(corners, face, x, y)
        z = share[0] * corners[at + 4] + share[1] * corners[at + 9] + share[2] * corners[at + 14]
        u = (share[0] * corners[at + 2] + share[1] * corners[at + 7] + share[2] * corners[at + 12]) / z
        v = (share[0] * corners[at + 3] + share[1] * corners[at + 8] + share[2] * corners[at + 13]) / z
    for channel in range(3):
        value = float(0.0)
        if face >= 0:
            value = scale * sample(picture, width, height, channels, wp.min(channel, channels - 1), u, v)
        texture_out[texel * 3 + channel] = wp.uint8(wp.min(value, 255.0) + 0.5)
