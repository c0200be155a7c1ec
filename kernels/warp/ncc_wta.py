"""Correlation and winner takes all in one pass that never holds the volume: the form for GPUs.

A thread owns one column over a strip of rows and walks its disparities; neighbouring threads touch
neighbouring addresses. The box sum of every disparity runs down the strip in scratch, D x W floats a strip.
"""

import warp as wp

from stereo_gpu.kernels.warp.ncc_volume import row_product
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
def ncc_wta(
    # In:
    reference: wp.array(dtype=float),
    other: wp.array(dtype=float),
    reference_sum: wp.array(dtype=float),
    reference_inverse: wp.array(dtype=float),
    other_sum: wp.array(dtype=float),
    other_inverse: wp.array(dtype=float),
    validity: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    smallest: int,
    disparities: int,
    radius: int,
    direction: int,
    subpixel: int,
    rows: int,
    scratch: wp.array(dtype=float),
    # Out:
    disparity_out: wp.array(dtype=float),
    score_out: wp.array(dtype=float),
    ratio_out: wp.array(dtype=float),
    validity_out: wp.array(dtype=wp.uint8),
    other_out: wp.array(dtype=int),
):
    """What ncc_volume followed by wta computes, without the volume; other_out must come in as 0."""
    strip, x = wp.tid()
    count = float((2 * radius + 1) * (2 * radius + 1))
    first = strip * rows
    bits = index_bits(disparities)
    boxes = strip * disparities * width + x
    for i in range(disparities):
        scratch[boxes + i * width] = 0.0
    for step in range(2 * radius + wp.min(rows, height - first)):
        y = first + step - 2 * radius
        entering = wp.clamp(y + radius, 0, height - 1) * width
        # The row that left the window when it moved down to y; before the first row nothing has.
        leaving = wp.clamp(y - radius - 1, 0, height - 1) * width
        pixel = y * width + x
        peaks = no_peaks()
        for i in range(disparities):
            u = x + direction * (smallest + i)
            if u >= 0 and u < width:
                box = scratch[boxes + i * width]
                box += row_product(reference, other, entering, x, u, width, radius)
                if y > first:
                    box -= row_product(reference, other, leaving, x, u, width, radius)
                scratch[boxes + i * width] = box
                if y >= first:
                    # This order of operations is the same in every form of the correlation, so that all agree.
                    score = (
                        (box - (reference_sum[pixel] / count) * other_sum[y * width + u]) * reference_inverse[pixel]
                    ) * other_inverse[y * width + u]
                    level = score_level(score, bits)
                    peaks = see(peaks, level, i)
                    key = winner_key(level, i, bits)
                    # Most scores lose: reading first spares the atomic.
                    if level > 0 and key > other_out[y * width + u]:
                        wp.atomic_max(other_out, y * width + u, key)
            elif y >= first:
                peaks = see(peaks, 0, i)
        if y >= first:
            score_out[pixel] = float(peaks.best) / score_scale(bits)
            disparity_out[pixel] = wp.nan
            ratio_out[pixel] = 0.0
            validity_out[pixel] = validity[pixel]
            if peaks.best > 0:
                disparity_out[pixel] = peak_disparity(peaks, smallest, subpixel)
                ratio_out[pixel] = float(peaks.runner) / float(peaks.best)
            elif validity[pixel] == wp.uint8(0):
                validity_out[pixel] = wp.uint8(OUT_OF_RANGE)
