"""Resample a picture into a texture atlas."""

import warp as wp

from stereo_gpu.kernels.warp.cubic import sample_cubic
from stereo_gpu.kernels.warp.light import light_at, put_light

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def bake(
    # In:
    light: wp.array(dtype=wp.uint16),
    places: wp.array(dtype=float),
    width: int,
    height: int,
    cell: float,
    bias: float,
    gain: float,
    texture_width: int,
    texture_height: int,
    # Out:
    texture_out: wp.array(dtype=wp.uint16),
):
    """Adds (sample - bias) gain to every texel that has a place in the picture, see place.py, within 0..65535.

    The fourth number of such a texel becomes 65535. A pixel of `light` is `cell` pixels of that picture wide.
    """
    y, x = wp.tid()
    texel = y * texture_width + x
    u = places[texel]
    v = places[texture_width * texture_height + texel]
    if u == u:
        share = 1.0 / cell
        value = sample_cubic(light, width, height, (u + 0.5) * share - 0.5, (v + 0.5) * share - 0.5)
        sum = light_at(texture_out, texel) + (value - wp.vec4(bias, bias, bias, bias)) * gain
        put_light(texture_out, texel, wp.vec4(sum[0], sum[1], sum[2], 65535.0))
