"""The next coarser level of a picture with gaps."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def pull(
    # In:
    fine: wp.array(dtype=wp.uint16),
    fine_width: int,
    fine_height: int,
    width: int,
    height: int,
    # Out:
    coarse_out: wp.array(dtype=wp.uint16),
):
    """Mean of those of 2 x 2 texels that are there (their fourth number is not 0); 0 where none is.

    (Gortler et al., "The Lumigraph", SIGGRAPH 1996, section 3.4.3: pull.) width and height are the coarser level's,
    half as much, rounded up.
    """
    y, x = wp.tid()
    red = int(0)
    green = int(0)
    blue = int(0)
    many = int(0)
    for k in range(4):
        column = 2 * x + (k & 1)
        row = 2 * y + (k >> 1)
        if column < fine_width and row < fine_height:
            at = (row * fine_width + column) * 4
            if fine[at + 3] != wp.uint16(0):
                red += int(fine[at])
                green += int(fine[at + 1])
                blue += int(fine[at + 2])
                many += 1
    each = wp.max(many, 1)
    to = (y * width + x) * 4
    coarse_out[to] = wp.uint16((red + each // 2) // each)
    coarse_out[to + 1] = wp.uint16((green + each // 2) // each)
    coarse_out[to + 2] = wp.uint16((blue + each // 2) // each)
    coarse_out[to + 3] = wp.uint16(65535 * wp.min(many, 1))
