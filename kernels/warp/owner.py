"""Who owns a texel: a triangle's number from 1, and INSIDE where it holds the texel's centre; 0 is nobody.

CLOSE is added where it is nearer than half of what is near at all. So the largest number wins.
"""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

INSIDE = wp.constant(1 << 30)
CLOSE = wp.constant(1 << 29)


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
