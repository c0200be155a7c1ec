"""Winner takes all over a volume of scores, for both views: the form for CPUs."""

import warp as wp

from stereo_gpu.kernels.warp.peaks import (
    OUT_OF_RANGE,
    index_bits,
    no_peaks,
    peak_disparity,
    score_level,
    score_scale,
    see,
    winner_key,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def wta(
    # In:
    volume: wp.array(dtype=float),
    validity: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    smallest: int,
    disparities: int,
    direction: int,
    subpixel: int,
    # Out:
    disparity_out: wp.array(dtype=float),
    score_out: wp.array(dtype=float),
    ratio_out: wp.array(dtype=float),
    validity_out: wp.array(dtype=wp.uint8),
    other_out: wp.array(dtype=int),
):
    """Disparity (px), score and runner-up over best of every pixel; the other view's winner_key.

    The thread of pixel (x, y) also gathers the winner of the other view's pixel (x, y).
    """
    y, x = wp.tid()
    pixel = y * width + x
    bits = index_bits(disparities)
    peaks = no_peaks()
    other_key = int(0)
    for i in range(disparities):
        peaks = see(peaks, score_level(volume[pixel * disparities + i], bits), i)
        source = x - direction * (smallest + i)
        if source >= 0 and source < width:
            level = score_level(volume[(y * width + source) * disparities + i], bits)
            if level > 0:
                other_key = wp.max(other_key, winner_key(level, i, bits))
    other_out[pixel] = other_key
    score_out[pixel] = float(peaks.best) / score_scale(bits)
    disparity_out[pixel] = wp.nan
    ratio_out[pixel] = 0.0
    validity_out[pixel] = validity[pixel]
    if peaks.best > 0:
        disparity_out[pixel] = peak_disparity(peaks, smallest, subpixel)
        ratio_out[pixel] = float(peaks.runner) / float(peaks.best)
        validity_out[pixel] = wp.uint8(0)
    elif validity[pixel] == wp.uint8(0):
        validity_out[pixel] = wp.uint8(OUT_OF_RANGE)
