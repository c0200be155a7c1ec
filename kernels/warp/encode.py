"""Linear light as a picture's levels."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def encode(
    # In:
    light: wp.array(dtype=wp.uint16),
    table: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    # Out:
    picture_out: wp.array(dtype=wp.uint8),
):
    """Levels 0 to 255 of every texel's red, green and blue, by a table of 65536; its fourth number is left out."""
    y, x = wp.tid()
    texel = y * width + x
    for channel in range(3):
        picture_out[texel * 3 + channel] = table[int(light[texel * 4 + channel])]
