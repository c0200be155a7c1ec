"""Where in another picture each texel of a mesh lies."""

import warp as wp

from stereo_gpu.kernels.warp.owner import CLOSE, INSIDE, weights

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def within(v: float, a: float, b: float, c: float, margin: float) -> float:
    """The number, at most `margin` beyond the smallest and the largest of three."""
    return wp.min(wp.max(v, wp.min(a, wp.min(b, c)) - margin), wp.max(a, wp.max(b, c)) + margin)


@wp.kernel
def place(
    # In:
    corners: wp.array(dtype=float),
    owner: wp.array(dtype=int),
    margin: float,
    texture_width: int,
    texture_height: int,
    # Out:
    place_out: wp.array(dtype=float),
):
    """Place that the centre of every texel shows, all columns u first, then all rows v; NaN where no triangle owns it.

    corners is (F, 3, 5): a corner's place in texels, its place (u, v) in the other picture, and its weight there: the
    depth where the texels lie on the mesh, 1 / depth where they are a camera's pixels. Beside its triangle a texel goes
    on as if all weights were equal, since a plane that is seen edge on may lie anywhere there, and at most `margin`
    beyond the places of its corners.
    """
    y, x = wp.tid()
    texel = y * texture_width + x
    number = owner[texel]
    u = float(wp.nan)
    v = float(wp.nan)
    if number != 0:
        face = (number & (CLOSE - 1)) - 1
        at = face * 15
        share = weights(corners, face, x, y)
        a = share[0]
        b = share[1]
        c = share[2]
        if number > INSIDE:
            a *= corners[at + 4]
            b *= corners[at + 9]
            c *= corners[at + 14]
        sum = a + b + c
        au = corners[at + 2]
        av = corners[at + 3]
        bu = corners[at + 7]
        bv = corners[at + 8]
        cu = corners[at + 12]
        cv = corners[at + 13]
        u = within((a * au + b * bu + c * cu) / sum, au, bu, cu, margin)
        v = within((a * av + b * bv + c * cv) / sum, av, bv, cv, margin)
    place_out[texel] = u
    place_out[texture_width * texture_height + texel] = v
