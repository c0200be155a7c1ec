"""Winner takes all over a volume of scores, for both views."""

import warp as wp

from stereo_gpu.kernels.warp.peaks import OUT_OF_RANGE, Peaks, peak_disparity, see, winner_key

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
    """Disparity (px), score and second best peak over best of every pixel; the other view's winner_key.

    The thread of pixel (x, y) also gathers the winner of the other view's pixel (x, y).
    """
    y, x = wp.tid()
    pixel = y * width + x
    peaks = Peaks()
    other_key = int(0)
    for i in range(disparities):
        peaks = see(peaks, volume[pixel * disparities + i], i)
        source = x - direction * (smallest + i)
        if source >= 0 and source < width:
            score = volume[(y * width + source) * disparities + i]
            other_key = wp.max(other_key, winner_key(score, i))
    peaks = see(peaks, 0.0, disparities)
    other_out[pixel] = other_key
    score_out[pixel] = peaks.best
    disparity_out[pixel] = wp.nan
    ratio_out[pixel] = 0.0
    validity_out[pixel] = validity[pixel]
    if peaks.best > 0.0:
        disparity_out[pixel] = peak_disparity(peaks, smallest, subpixel)
        ratio_out[pixel] = peaks.second / peaks.best
        validity_out[pixel] = wp.uint8(0)
    elif validity[pixel] == wp.uint8(0):
        validity_out[pixel] = wp.uint8(OUT_OF_RANGE)
