"""Left-right check: the form for CPUs.

A work-item takes a row. Which pixels some winner of the other view points back at is marked once, so that the
verdict does not search the disparities.
"""

import warp as wp

from stereo_gpu.kernels.warp.peaks import index_bits

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

OCCLUDED = wp.constant(4)
MISMATCH = wp.constant(8)
HELD = wp.constant(4096)  # columns whose marks are held at a time


@wp.kernel
def consistency(
    # In:
    disparity: wp.array(dtype=float),
    other: wp.array(dtype=int),
    validity: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    smallest: int,
    disparities: int,
    direction: int,
    tolerance: float,
    # Out:
    disparity_out: wp.array(dtype=float),
    validity_out: wp.array(dtype=wp.uint8),
):
    """Take a disparity away where the other view's winner differs from it by more than tolerance px.

    other holds winner_key. After Hirschmueller (PAMI 2008): a pixel is a mismatch if some disparity would have
    agreed with the other view, else it is occluded, as is one whose match lies outside of the other picture.
    """
    y = wp.tid()
    row = y * width
    mask = (1 << index_bits(disparities)) - 1
    # How far from a pixel the columns lie that may point back at it.
    one = direction * smallest
    two = direction * (smallest + disparities - 1)
    marked = wp.zeros(shape=(HELD,), dtype=wp.uint8)
    for left in range(0, width, HELD):
        held = wp.min(HELD, width - left)
        for x in range(held):
            marked[x] = wp.uint8(OCCLUDED)
        for u in range(wp.max(0, left + wp.min(one, two)), wp.min(width, left + held + wp.max(one, two))):
            key = other[row + u]
            index = mask - (key & mask)
            x = u - direction * (smallest + index) - left
            if key > 0 and index < disparities and x >= 0 and x < held:
                marked[x] = wp.uint8(MISMATCH)
        for x in range(held):
            pixel = row + left + x
            value = disparity[pixel]
            reason = validity[pixel]
            if not wp.isnan(value):
                u = left + x + direction * int(wp.floor(value + 0.5))
                # The sub-pixel part may round to one pixel past the edge.
                key = other[row + wp.clamp(u, 0, width - 1)]
                back = float(smallest + mask - (key & mask))
                outside = u < -1 or u > width
                if outside or key <= 0 or wp.abs(back - value) > tolerance:
                    reason = marked[x]
                    if outside:
                        reason = wp.uint8(OCCLUDED)
                    value = wp.nan
            disparity_out[pixel] = value
            validity_out[pixel] = reason
