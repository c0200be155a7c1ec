"""Grow the baked charts by one texel, so that no seam shows between them."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def dilate(
    # In:
    texture: wp.array(dtype=wp.uint8),
    covered: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    # Out:
    texture_out: wp.array(dtype=wp.uint8),
    covered_out: wp.array(dtype=wp.uint8),
):
    """Give a texel without colour the mean of its coloured neighbours among the eight around it."""
    y, x = wp.tid()
    texel = y * width + x
    coloured = int(0)
    red = float(0.0)
    green = float(0.0)
    blue = float(0.0)
    for k in range(9):
        row = y + k // 3 - 1
        column = x + k % 3 - 1
        if row >= 0 and row < height and column >= 0 and column < width:
            near = row * width + column
            if covered[near] != wp.uint8(0) and (covered[texel] == wp.uint8(0) or near == texel):
                coloured += 1
                red += float(texture[near * 3])
                green += float(texture[near * 3 + 1])
                blue += float(texture[near * 3 + 2])
    covered_out[texel] = wp.uint8(wp.min(coloured, 1))
    many = float(wp.max(coloured, 1))
    texture_out[texel * 3] = wp.uint8(red / many + 0.5)
    texture_out[texel * 3 + 1] = wp.uint8(green / many + 0.5)
    texture_out[texel * 3 + 2] = wp.uint8(blue / many + 0.5)
