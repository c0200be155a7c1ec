"""Left-right check of two maps: what a view sees, the other view must see too."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

OCCLUDED = wp.constant(4)
MISMATCH = wp.constant(8)


@wp.kernel
def agree(
    # In:
    disparity: wp.array(dtype=float),
    validity: wp.array(dtype=wp.uint8),
    other_disparity: wp.array(dtype=float),
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
    """Take a disparity away where the other view's own map differs by more than tolerance px where it points at.

    After Hirschmueller (PAMI 2008), section 2.5: a pixel is a mismatch if the other view sees a point somewhere on
    its ray, which is a whole disparity of the range to tolerance px, else it is occluded.
    """
    y, x = wp.tid()
    row = y * width
    value = disparity[row + x]
    disparity_out[row + x] = value
    validity_out[row + x] = validity[row + x]
    if wp.isnan(value):
        return
    u = x + direction * int(wp.floor(value + 0.5))
    if u >= 0 and u < width:
        if wp.abs(other_disparity[row + u] - value) <= tolerance:
            return
    verdict = int(OCCLUDED)
    for i in range(disparities):
        u = x + direction * (smallest + i)
        if u >= 0 and u < width:
            if wp.abs(other_disparity[row + u] - float(smallest + i)) <= tolerance:
                verdict = MISMATCH
                break
    disparity_out[row + x] = wp.nan
    validity_out[row + x] = wp.uint8(verdict)
