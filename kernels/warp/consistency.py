"""Left-right check: the other view's winner must point back."""

import warp as wp

from stereo_gpu.kernels.warp.peaks import index_bits, key_index

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

OCCLUDED = wp.constant(4)
MISMATCH = wp.constant(8)


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
    y, x = wp.tid()
    pixel = y * width + x
    value = disparity[pixel]
    disparity_out[pixel] = value
    validity_out[pixel] = validity[pixel]
    if wp.isnan(value):
        return
    u = x + direction * int(wp.floor(value + 0.5))
    if u < -1 or u > width:
        disparity_out[pixel] = wp.nan
        validity_out[pixel] = wp.uint8(OCCLUDED)
        return
    # The sub-pixel part may round to one pixel past the edge.
    key = other[y * width + wp.clamp(u, 0, width - 1)]
    bits = index_bits(disparities)
    back = float(smallest + key_index(key, bits))
    if key > 0 and wp.abs(back - value) <= tolerance:
        return
    verdict = int(OCCLUDED)
    for i in range(disparities):
        candidate = x + direction * (smallest + i)
        if candidate >= 0 and candidate < width:
            key = other[y * width + candidate]
            if key > 0 and key_index(key, bits) == i:
                verdict = MISMATCH
    disparity_out[pixel] = wp.nan
    validity_out[pixel] = wp.uint8(verdict)
