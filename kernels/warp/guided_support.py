"""Drop disparities that those surroundings that look alike do not share."""

import warp as wp

from stereo_gpu.kernels.warp.likeness import MASKED, furthest, neighbour_weight

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

MISMATCH = wp.constant(8)
HOLE = wp.constant(0.25)  # of the weight of a neighbour without a value counts against


@wp.kernel
def guided_support(
    # In:
    disparity: wp.array(dtype=float),
    validity: wp.array(dtype=wp.uint8),
    guide: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    reach: int,
    step: int,
    tolerance: float,
    slope: float,
    share: float,
    # Out:
    disparity_out: wp.array(dtype=float),
    validity_out: wp.array(dtype=wp.uint8),
):
    """Keep a value that at least share of the pixels around it (within reach, every step-th) have, to tolerance px.

    Pixels count by how much they look like the one in question in the guide, three planes of bytes; those without a
    value count a quarter, against it, and masked ones not at all.

    A surface may lean: the tolerance grows by slope px with each row or column of distance.
    """
    y, x = wp.tid()
    pixel = y * width + x
    half_way = reach // step
    value = disparity[pixel]
    reason = int(validity[pixel])
    disparity_out[pixel] = value
    validity_out[pixel] = wp.uint8(reason)
    if wp.isnan(value) or (reason & MASKED) != 0:
        return
    total = float(0.0)
    agreeing = float(0.0)
    for j in range(-half_way, half_way + 1):
        row = y + j * step
        if row >= 0 and row < height:
            for i in range(-half_way, half_way + 1):
                column = x + i * step
                if column >= 0 and column < width:
                    there = row * width + column
                    weight = neighbour_weight(guide, validity, width * height, pixel, there)
                    theirs = disparity[there]
                    allowed = tolerance + slope * float(furthest(i * step, j * step))
                    total += wp.where(wp.isnan(theirs), HOLE * weight, weight)
                    agreeing += wp.where(wp.abs(theirs - value) <= allowed, weight, 0.0)
    if agreeing < share * total:
        disparity_out[pixel] = wp.nan
        validity_out[pixel] = wp.uint8(reason | MISMATCH)
