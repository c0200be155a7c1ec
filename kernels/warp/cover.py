"""Which triangle each texel of the atlas belongs to."""

import warp as wp

from stereo_gpu.kernels.warp.owner import CLOSE, INSIDE, weights

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def squared(x: float, y: float) -> float:
    """Squared length of a side."""
    return x * x + y * y


@wp.func
def beyond(share: float, area: float) -> float:
    """How far outside of a side a texel is, times the side's length, squared; 0 inside."""
    if share >= 0.0:
        return 0.0
    return share * area * (share * area)


@wp.kernel
def cover(
    # In:
    corners: wp.array(dtype=float),
    triangles: int,
    reach: float,
    texture_width: int,
    texture_height: int,
    # Out:
    owner_out: wp.array(dtype=int),
):
    """Number of the last triangle that holds the texel's centre, counted from 1, and INSIDE.

    Where none does, of the last one that has it within half of `reach` texels of its sides, and CLOSE, or within
    `reach`. Must come in as 0. corners is (F, 3, 5), a corner's place in the atlas in texels first. The last one wins
    whatever the order in which triangles are drawn, so that a texture does not change from run to run.
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
    # A weight times the area is the distance from its side times that side's length.
    far_a = reach * reach * squared(bx - cx, by - cy)
    far_b = reach * reach * squared(cx - ax, cy - ay)
    far_c = reach * reach * squared(ax - bx, ay - by)
    first_x = wp.clamp(int(wp.floor(wp.min(ax, wp.min(bx, cx)) - reach)), 0, texture_width)
    first_y = wp.clamp(int(wp.floor(wp.min(ay, wp.min(by, cy)) - reach)), 0, texture_height)
    last_x = wp.clamp(int(wp.ceil(wp.max(ax, wp.max(bx, cx)) + reach)), 0, texture_width)
    last_y = wp.clamp(int(wp.ceil(wp.max(ay, wp.max(by, cy)) + reach)), 0, texture_height)
    for y in range(first_y, last_y):
        for x in range(first_x, last_x):
            share = weights(corners, face, x, y)
            a = beyond(share[0], area)
            b = beyond(share[1], area)
            c = beyond(share[2], area)
            number = int(0)
            if share[0] >= 0.0 and share[1] >= 0.0 and share[2] >= 0.0:
                number = face + 1 + INSIDE
            elif 4.0 * a <= far_a and 4.0 * b <= far_b and 4.0 * c <= far_c:
                number = face + 1 + CLOSE
            elif a <= far_a and b <= far_b and c <= far_c:
                number = face + 1
            if number > 0:
                wp.atomic_max(owner_out, y * texture_width + x, number)
