"""Median of the valid neighbours."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def median(
    # In:
    disparity: wp.array(dtype=float),
    width: int,
    height: int,
    size: int,
    # Out:
    disparity_out: wp.array(dtype=float),
):
    """Median over size x size (3, 5 or 7) neighbours that have a value; of an even number the lower one.

    A pixel without a value stays without. From the pixel's own value it goes to the next larger or smaller one until
    half of the values lie below: few steps where a map is smooth, and no array of values, which no GPU holds in
    registers.
    """
    y, x = wp.tid()
    pixel = y * width + x
    radius = size // 2
    middle = disparity[pixel]
    disparity_out[pixel] = middle
    if wp.isnan(middle):
        return
    top = wp.max(y - radius, 0)
    bottom = wp.min(y + radius, height - 1)
    left = wp.max(x - radius, 0)
    right = wp.min(x + radius, width - 1)
    # Values in all, below the middle, and equal to it; comparisons with what is missing are false.
    count = int(0)
    below = int(0)
    equal = int(0)
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            value = disparity[row * width + column]
            count += wp.where(value == value, 1, 0)
            below += wp.where(value < middle, 1, 0)
            equal += wp.where(value == middle, 1, 0)
    wanted = (count - 1) // 2
    while below > wanted or below + equal <= wanted:
        down = below > wanted
        found = int(0)
        next = float(wp.inf)
        if down:
            next = -next
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                value = disparity[row * width + column]
                beyond = value > middle
                nearer = value < next
                if down:
                    beyond = value < middle
                    nearer = value > next
                if beyond and nearer:
                    next = value
                    found = 1
                elif beyond and value == next:
                    found += 1
        if down:
            below -= found
        else:
            below += equal
        equal = found
        middle = next
    disparity_out[pixel] = middle
