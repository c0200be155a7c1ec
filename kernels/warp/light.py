"""Pictures of linear light: red, green, blue and a fourth number, 16 bits each."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def light_at(light: wp.array(dtype=wp.uint16), index: int) -> wp.vec4:
    """A pixel's numbers, to compute with."""
    at = index * 4
    return wp.vec4(float(light[at]), float(light[at + 1]), float(light[at + 2]), float(light[at + 3]))


@wp.func
def put_light(light: wp.array(dtype=wp.uint16), index: int, v: wp.vec4):
    """Write a pixel, rounded, within 0..65535."""
    for k in range(4):
        light[index * 4 + k] = wp.uint16(wp.min(wp.max(v[k], 0.0), 65535.0) + 0.5)
