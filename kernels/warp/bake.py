"""Resample a picture into a texture atlas, triangle by triangle."""

from typing import Any

import warp as wp

from stereo_gpu.kernels.warp.sampling import sample

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def bake(
    # In:
    picture: wp.array(dtype=Any),
    corners: wp.array(dtype=float),
    width: int,
    height: int,
    channels: int,
    triangles: int,
    scale: float,
    texture_width: int,
    texture_height: int,
    # Out:
    texture_out: wp.array(dtype=wp.uint8),
    covered_out: wp.array(dtype=wp.uint8),
):
    """Colour of every texel whose centre lies in a triangle, and 1 in covered_out; both must come in as 0.

    corners is (F, 3, 5): a corner's place in the atlas in texels, and u z, v z, z of its pixel (u, v) in the
    picture, so that perspective stays exact inside of a triangle. scale takes the picture's values to 0..255.
    """
    face = wp.tid()
    at = face * 15
    ax = corners[at]
    ay = corners[at + 1]
    bx = corners[at + 5]
    by = corners[at + 6]
    cx = corners[at + 10]
    cy = corners[at + 11]
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if area == 0.0:
        return
    first_x = wp.clamp(int(wp.floor(wp.min(ax, wp.min(bx, cx)))), 0, texture_width)
    first_y = wp.clamp(int(wp.floor(wp.min(ay, wp.min(by, cy)))), 0, texture_height)
    last_x = wp.clamp(int(wp.ceil(wp.max(ax, wp.max(bx, cx)))), 0, texture_width)
    last_y = wp.clamp(int(wp.ceil(wp.max(ay, wp.max(by, cy)))), 0, texture_height)
    for y in range(first_y, last_y):
        for x in range(first_x, last_x):
            px = float(x) + 0.5
            py = float(y) + 0.5
            a = ((bx - px) * (cy - py) - (by - py) * (cx - px)) / area
            b = ((cx - px) * (ay - py) - (cy - py) * (ax - px)) / area
            c = 1.0 - a - b
            if a >= 0.0 and b >= 0.0 and c >= 0.0:
                z = a * corners[at + 4] + b * corners[at + 9] + c * corners[at + 14]
                u = (a * corners[at + 2] + b * corners[at + 7] + c * corners[at + 12]) / z
                v = (a * corners[at + 3] + b * corners[at + 8] + c * corners[at + 13]) / z
                texel = y * texture_width + x
                covered_out[texel] = wp.uint8(1)
                for channel in range(3):
                    value = sample(picture, width, height, channels, wp.min(channel, channels - 1), u, v)
                    texture_out[texel * 3 + channel] = wp.uint8(wp.min(value * scale, 255.0) + 0.5)
