"""Fill small holes along the row."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

MASKED = wp.constant(16)
FILLED = wp.constant(32)


@wp.func
def usable(validity: wp.array(dtype=wp.uint8), row: int, column: int, width: int) -> bool:
    """Whether a column lies in the picture and the mask."""
    if column < 0 or column >= width:
        return False
    return validity[row + column] != wp.uint8(MASKED)


@wp.func
def value_at(
    disparity: wp.array(dtype=float), validity: wp.array(dtype=wp.uint8), row: int, column: int, width: int
) -> float:
    """The disparity there, NaN outside of picture or mask."""
    if usable(validity, row, column, width):
        return disparity[row + column]
    return wp.nan


@wp.func
def empty(
    disparity: wp.array(dtype=float), validity: wp.array(dtype=wp.uint8), row: int, column: int, width: int
) -> bool:
    """Whether a column belongs to a hole: usable, but without a value."""
    return usable(validity, row, column, width) and wp.isnan(disparity[row + column])


@wp.kernel
def fill(
    # In:
    disparity: wp.array(dtype=float),
    validity: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    reach: int,
    tolerance: float,
    # Out:
    disparity_out: wp.array(dtype=float),
    validity_out: wp.array(dtype=wp.uint8),
):
    """Give a value to holes of at most reach pixels in a row; a filled pixel carries FILLED.

    Ends that agree to tolerance px are joined by a line; else the hole is background that the nearer surface
    hides from the other camera, and takes the smaller disparity. A hole that ends at the picture's or the
    mask's edge stays: nothing tells what is there.
    """
    y, x = wp.tid()
    pixel = y * width + x
    disparity_out[pixel] = disparity[pixel]
    validity_out[pixel] = validity[pixel]
    if not wp.isnan(disparity[pixel]) or validity[pixel] == wp.uint8(MASKED):
        return
    left = int(1)
    while left <= reach and empty(disparity, validity, y * width, x - left, width):
        left += 1
    right = int(1)
    while right <= reach and empty(disparity, validity, y * width, x + right, width):
        right += 1
    if left + right - 1 > reach:
        return
    before = value_at(disparity, validity, y * width, x - left, width)
    after = value_at(disparity, validity, y * width, x + right, width)
    if wp.isnan(before) or wp.isnan(after):
        return
    # Counted from the lower end, so that a mirrored picture rounds alike.
    value = wp.min(before, after)
    rise = wp.max(before, after) - value
    if rise <= tolerance:
        steps = right
        if before < after:
            steps = left
        value += rise * (float(steps) / float(left + right))
    disparity_out[pixel] = value
    validity_out[pixel] = wp.uint8(FILLED)
