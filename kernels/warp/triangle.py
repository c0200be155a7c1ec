"""Where a sample lies in a triangle of a picture."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Triangle:
    """A triangle's corners: their places in the picture, px, and 1 / depth; and twice its area, px^2.

    The area is below 0 where its corners run counter-clockwise as seen, as those of a face do that is seen from the
    front.
    """

    a: wp.vec3
    b: wp.vec3
    c: wp.vec3
    area: float


@wp.func
def load_triangle(screen: wp.array(dtype=float), faces: wp.array(dtype=int), face: int) -> Triangle:
    """The triangle of a face."""
    a = faces[face * 3] * 3
    b = faces[face * 3 + 1] * 3
    c = faces[face * 3 + 2] * 3
    t = Triangle()
    t.a = wp.vec3(screen[a], screen[a + 1], screen[a + 2])
    t.b = wp.vec3(screen[b], screen[b + 1], screen[b + 2])
    t.c = wp.vec3(screen[c], screen[c + 1], screen[c + 2])
    t.area = (t.b[0] - t.a[0]) * (t.c[1] - t.a[1]) - (t.b[1] - t.a[1]) * (t.c[0] - t.a[0])
    return t


@wp.func
def can_be_seen(t: Triangle) -> bool:
    """Whether it can be seen: no corner is behind the camera, and it is not seen edge on."""
    return t.a[2] > 0.0 and t.b[2] > 0.0 and t.c[2] > 0.0 and (t.area > 0.0 or t.area < 0.0)


@wp.func
def shares_at(t: Triangle, x: float, y: float) -> wp.vec3:
    """Shares of the three corners, in the picture.

    An edge is tested by the same products for both of its triangles, so that their shares of it differ in sign alone
    and no crack can open between them.
    """
    ax = t.a[0] - x
    ay = t.a[1] - y
    bx = t.b[0] - x
    by = t.b[1] - y
    cx = t.c[0] - x
    cy = t.c[1] - y
    scale = 1.0 / t.area
    return wp.vec3((bx * cy - by * cx) * scale, (cx * ay - cy * ax) * scale, (ax * by - ay * bx) * scale)


@wp.func
def least(a: float, b: float, c: float) -> float:
    """The smallest of three."""
    return wp.min(a, wp.min(b, c))


@wp.func
def most(a: float, b: float, c: float) -> float:
    """The largest of three."""
    return wp.max(a, wp.max(b, c))


@wp.func
def first_sample(v: float, low: int, high: int) -> int:
    """The first whole number that is not below v, between low and high."""
    first = high
    if not v > float(low):
        first = low
    elif v < float(high):
        first = int(wp.ceil(v))
    return first


@wp.func
def past_samples(v: float, low: int, high: int) -> int:
    """One past the last whole number that is not above v, between low and high."""
    past = high
    if not v >= float(low):
        past = low
    elif v < float(high):
        past = int(wp.floor(v)) + 1
    return past
