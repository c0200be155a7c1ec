"""What a textured mesh, seen from the camera of its picture, lacks of that picture."""

import warp as wp

from stereo_gpu.kernels.warp.light import light_at, put_light

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def residual(
    # In:
    light: wp.array(dtype=wp.uint16),
    texture: wp.array(dtype=wp.uint16),
    places: wp.array(dtype=float),
    texture_width: int,
    texture_height: int,
    width: int,
    height: int,
    # Out:
    residual_out: wp.array(dtype=wp.uint16),
):
    """32768 and half the difference of a pixel's light to the texture's at its place, see place.py.

    The texture is sampled bilinearly, as a viewer does; texel centres are at whole numbers. 32768 where a pixel has no
    place, or a texel is missing.
    """
    y, x = wp.tid()
    pixel = y * width + x
    s = places[pixel]
    t = places[width * height + pixel]
    missing = wp.vec4(0.0, 0.0, 0.0, 0.0)
    if s == s:
        left = int(wp.floor(s))
        top = int(wp.floor(t))
        across = s - float(left)
        down = t - float(top)
        right = wp.clamp(left + 1, 0, texture_width - 1)
        bottom = wp.clamp(top + 1, 0, texture_height - 1) * texture_width
        left = wp.clamp(left, 0, texture_width - 1)
        top = wp.clamp(top, 0, texture_height - 1) * texture_width
        a = light_at(texture, top + left)
        b = light_at(texture, top + right)
        c = light_at(texture, bottom + left)
        d = light_at(texture, bottom + right)
        if a[3] > 0.0 and b[3] > 0.0 and c[3] > 0.0 and d[3] > 0.0:
            shown = (a * (1.0 - down) + c * down) * (1.0 - across) + (b * (1.0 - down) + d * down) * across
            missing = (light_at(light, pixel) - shown) * 0.5
    put_light(residual_out, pixel, missing + wp.vec4(32768.0, 32768.0, 32768.0, 32768.0))
