"""Which triangle each texel of the atlas belongs to."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def weights(corners: wp.array(dtype=float), face: int, x: int, y: int) -> wp.vec3:
    """Barycentric weights of the centre of texel (x, y) in a triangle; (-1, -1, -1) where it has no area."""
    at = face * 15
    ax = corners[at]
    ay = corners[at + 1]
    bx = corners[at + 5]
    by = corners[at + 6]
    cx = corners[at + 10]
    cy = corners[at + 11]
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if area == 0.0:
        return wp.vec3(-1.0, -1.0, -1.0)
    px = float(x) + 0.5
    py = float(y) + 0.5
    a = ((bx - px) * (cy - py) - (by - py) * (cx - px)) / area
    b = ((cx - px) * (ay - py) - (cy - py) * (ax - px)) / area
    return wp.vec3(a, b, 1.0 - a - b)


@wp.kernel
def cover(
    # In:
    corners: wp.array(dtype=float),
    triangles: int,
    texture_width: int,
    texture_height: int,
    # Out:
    owner_out: wp.array(dtype=int),
):
    """Number of the last triangle that holds the texel's centre, counted from 1; must come in as 0.

    corners is (F, 3, 5), a corner's place in the atlas in texels first. The last one wins whatever the order in
    which triangles are drawn, so that a texture does not change from run to run.
    """
    face = wp.tid()
    at = face * 15
    ax = corners[at]
    ay = corners[at + 1]
    bx = corners[at + 5]
    by = corners[at + 6]
    cx = corners[at + 10]
    cy = corners[at + 11]
    first_x = wp.clamp(int(wp.floor(wp.min(ax, wp.min(bx, cx)))), 0, texture_width)
    first_y = wp.clamp(int(wp.floor(wp.min(ay, wp.min(by, cy)))), 0, texture_height)
    last_x = wp.clamp(int(wp.ceil(wp.max(ax, wp.max(bx, cx)))), 0, texture_width)
    last_y = wp.clamp(int(wp.ceil(wp.max(ay, wp.max(by, cy)))), 0, texture_height)
    for y in range(first_y, last_y):
        for x in range(first_x, last_x):
            inside = weights(corners, face, x, y)
            if inside[0] >= 0.0 and inside[1] >= 0.0 and inside[2] >= 0.0:
                wp.atomic_max(owner_out, y * texture_width + x, face + 1)
