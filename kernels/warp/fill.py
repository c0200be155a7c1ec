"""Fill holes along rows or columns."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

MASKED = wp.constant(wp.uint8(16))
FILLED = wp.constant(wp.uint8(32))


@wp.func
def usable(validity: wp.array(dtype=wp.uint8), start: int, at: int, stride: int, length: int) -> bool:
    """Whether a place of a line, a row or a column, lies in the picture and the mask."""
    if at < 0 or at >= length:
        return False
    return (validity[start + at * stride] & MASKED) == wp.uint8(0)


@wp.func
def empty(
    disparity: wp.array(dtype=float),
    validity: wp.array(dtype=wp.uint8),
    start: int,
    at: int,
    stride: int,
    length: int,
) -> bool:
    """Whether a place of a line belongs to a hole: usable, but without a value."""
    return usable(validity, start, at, stride, length) and wp.isnan(disparity[start + at * stride])


@wp.func
def end_of(
    disparity: wp.array(dtype=float),
    validity: wp.array(dtype=wp.uint8),
    start: int,
    at: int,
    step: int,
    stride: int,
    length: int,
    near: int,
) -> float:
    """The disparity with which a hole ends at a place of a line that goes on from there in steps of 1 or -1.

    NaN at the edge of picture or mask.
    """
    if not usable(validity, start, at, stride, length):
        return wp.nan
    value = disparity[start + at * stride]
    for i in range(1, near):
        if not usable(validity, start, at + i * step, stride, length):
            return value
        following = disparity[start + (at + i * step) * stride]
        if not wp.isnan(following):
            return wp.min(value, following)
    return value


@wp.func
def between(before: float, after: float, from_before: int, from_after: int, edges: int, tolerance: float) -> float:
    """What a hole's pixel takes, so many steps from the hole's ends; NaN if nothing."""
    if wp.isnan(before) or wp.isnan(after):
        if edges == 0:
            return wp.nan
        if wp.isnan(before):
            return after
        return before
    # Counted from the lower end, so that a mirrored picture rounds alike.
    steps = from_after
    if before < after:
        steps = from_before
    low = wp.min(before, after)
    rise = wp.max(before, after) - low
    if rise <= tolerance:
        return low + rise * (float(steps) / float(from_before + from_after))
    return low


@wp.kernel
def fill(
    # In:
    disparity: wp.array(dtype=float),
    validity: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    axis: int,
    reach: int,
    near: int,
    edges: int,
    tolerance: float,
    # Out:
    disparity_out: wp.array(dtype=float),
    validity_out: wp.array(dtype=wp.uint8),
):
    """Give a value to holes of at most reach pixels in a row (axis 0) or column (axis 1).

    A filled pixel carries FILLED beside the reason it had. A hole's end is the smaller of the first two values in
    the `near` places next to it, or with near = 1 the value at its end: what lies at a jump is often wrong. Ends that
    agree to tolerance px are joined by a line; else the hole is background that the nearer surface hides from the
    other camera, and takes the smaller end. A hole that ends at the picture's or the mask's edge stays, or with
    edges != 0 takes the end that it has.
    """
    y, x = wp.tid()
    pixel = y * width + x
    disparity_out[pixel] = disparity[pixel]
    validity_out[pixel] = validity[pixel]
    if not wp.isnan(disparity[pixel]) or (validity[pixel] & MASKED) != wp.uint8(0):
        return
    at = int(x)
    length = width
    stride = int(1)
    if axis != 0:
        at = y
        length = height
        stride = width
    start = pixel - at * stride
    left = int(1)
    while left <= reach and empty(disparity, validity, start, at - left, stride, length):
        left += 1
    right = int(1)
    while right <= reach and empty(disparity, validity, start, at + right, stride, length):
        right += 1
    if left + right - 1 > reach:
        return
    before = end_of(disparity, validity, start, at - left, -1, stride, length, near)
    after = end_of(disparity, validity, start, at + right, 1, stride, length, near)
    value = between(before, after, left, right, edges, tolerance)
    if not wp.isnan(value):
        disparity_out[pixel] = value
        validity_out[pixel] = validity[pixel] | FILLED
