"""Median of the valid neighbours."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

Window = wp.types.vector(length=49, dtype=float)


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

    A pixel without a value stays without. Missing neighbours count in turn as lowest and highest, so that
    the middle of the whole window is the median of the rest.
    """
    y, x = wp.tid()
    pixel = y * width + x
    disparity_out[pixel] = disparity[pixel]
    if wp.isnan(disparity[pixel]):
        return
    radius = size // 2
    total = size * size
    values = Window()
    filler = float(-wp.inf)
    for k in range(total):
        row = y + k // size - radius
        column = x + k % size - radius
        value = float(wp.nan)
        if row >= 0 and row < height and column >= 0 and column < width:
            value = disparity[row * width + column]
        if wp.isnan(value):
            value = filler
            filler = -filler
        values[k] = value
    # Selection up to the middle: bring the smallest of the rest forward, half of the window long.
    for k in range(total // 2 + 1):
        low = values[k]
        for j in range(k + 1, total):
            value = values[j]
            values[j] = wp.max(low, value)
            low = wp.min(low, value)
        values[k] = low
    disparity_out[pixel] = values[total // 2]
