"""How much of what lies around a pixel both views agree about."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def agreement(
    # In:
    checked: wp.array(dtype=float),
    taken: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    radius: int,
    # Out:
    agreement_out: wp.array(dtype=float),
):
    """Share of the (2 radius + 1)^2 window's pixels that have a value in checked and are not taken.

    checked is NaN where the views disagree. Pixels outside of the picture do not count.
    """
    y, x = wp.tid()
    top = wp.max(y - radius, 0)
    bottom = wp.min(y + radius + 1, height)
    left = wp.max(x - radius, 0)
    right = wp.min(x + radius + 1, width)
    count = int(0)
    for j in range(top, bottom):
        for p in range(j * width + left, j * width + right):
            if not wp.isnan(checked[p]) and int(taken[p]) == 0:
                count += 1
    agreement_out[y * width + x] = float(count) / float((bottom - top) * (right - left))
