"""Winner takes all over sums of paths: the form for CPUs."""

import warp as wp

from stereo_gpu.kernels.warp.sums import OUT_OF_RANGE, UNMATCHED, lowest_disparity, sums_ratio

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def lowest(
    # In:
    sums: wp.array(dtype=wp.uint16),
    validity: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    smallest: int,
    disparities: int,
    subpixel: int,
    # Out:
    disparity_out: wp.array(dtype=float),
    lowest_out: wp.array(dtype=float),
    ratio_out: wp.array(dtype=float),
    validity_out: wp.array(dtype=wp.uint8),
):
    """What the form for GPUs computes."""
    y, x = wp.tid()
    pixel = y * width + x
    # An array made here has elements side by side, which the compiler can count on.
    own = wp.array(
        ptr=sums.ptr + wp.uint64(2) * wp.uint64(pixel) * wp.uint64(disparities), shape=(disparities,), dtype=wp.uint16
    )
    best = int(65535)
    for i in range(disparities):
        best = wp.min(best, int(own[i]))
    known = int(validity[pixel])
    disparity_out[pixel] = wp.nan
    lowest_out[pixel] = float(UNMATCHED)
    ratio_out[pixel] = 1.0
    validity_out[pixel] = wp.uint8(wp.where(known != 0, known, OUT_OF_RANGE))
    if known == 0 and best < UNMATCHED:
        at = int(0)
        while int(own[at]) != best:
            at += 1
        runner = int(65535)
        for i in range(0, at - 1):
            runner = wp.min(runner, int(own[i]))
        for i in range(at + 2, disparities):
            runner = wp.min(runner, int(own[i]))
        before = int(UNMATCHED)
        after = int(UNMATCHED)
        if at > 0:
            before = int(own[at - 1])
        if at < disparities - 1:
            after = int(own[at + 1])
        disparity_out[pixel] = lowest_disparity(at, best, before, after, smallest, subpixel)
        lowest_out[pixel] = float(best)
        ratio_out[pixel] = sums_ratio(best, runner)
        validity_out[pixel] = wp.uint8(0)
