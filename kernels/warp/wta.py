"""Winner takes all over a volume of scores, for both views: the form for GPUs.

A block owns SPAN columns of a row, a thread one disparity of each of them, so that neighbouring threads read
neighbouring scores; the keys pass through shared memory, where the threads look for the winners.
"""

import warp as wp

from stereo_gpu.kernels.warp.block import barrier, load, store
from stereo_gpu.kernels.warp.block_winners import (
    GROUP,
    HIGHEST,
    KEYS,
    PITCH,
    SECONDS,
    SPAN,
    highest_four,
    put,
    raise_winners,
    runner_level,
    search_column,
)
from stereo_gpu.kernels.warp.peaks import (
    OUT_OF_RANGE,
    index_bits,
    key_index,
    no_peaks,
    peak_disparity,
    score_level,
    score_scale,
    winner_key,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel(launch_bounds=(128, 8), grid_stride=False)
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
    """Disparity (px), score and runner-up over best of every pixel; the other view's winner_key, which comes in 0."""
    block, lane = wp.tid()
    tiles = (width + SPAN - 1) // SPAN
    x0 = (block % tiles) * SPAN
    y = block // tiles
    bits = index_bits(disparities)
    for k in range(lane, SPAN * PITCH, GROUP):
        put(KEYS + k, 0)
    barrier()

    two = wp.vec2i()
    for start in range(0, disparities, GROUP):
        # Threads of larger u come later.
        i = start + wp.where(direction < 0, GROUP - 1 - lane, lane)
        u0 = x0 + direction * (smallest + start) + wp.min(direction, 0) * (GROUP - 1)
        for s in range(SPAN):
            key = int(0)
            if x0 + s < width and i < disparities:
                level = score_level(load(volume, (y * width + x0 + s) * disparities + i), bits)
                if level > 0:
                    key = winner_key(level, i, bits)
            put(KEYS + lane + s * PITCH, key)
        barrier()
        # Disparities of one class in all chunks are of one class still.
        two = search_column(two, lane)
        raise_winners(other_out, y * width, u0, lane, width)
        barrier()
    put(HIGHEST + lane, two[0])
    put(SECONDS + lane, two[1])
    barrier()

    if lane < SPAN and x0 + lane < width:
        pixel = y * width + x0 + lane
        four = highest_four(lane)
        peaks = no_peaks()
        peaks.best = four[0] >> bits
        store(score_out, pixel, float(peaks.best) / score_scale(bits))
        if peaks.best > 0:
            peaks.index = key_index(four[0], bits)
            if peaks.index > 0:
                peaks.before = score_level(load(volume, pixel * disparities + peaks.index - 1), bits)
            if peaks.index < disparities - 1:
                peaks.after = score_level(load(volume, pixel * disparities + peaks.index + 1), bits)
            store(disparity_out, pixel, peak_disparity(peaks, smallest, subpixel))
            store(ratio_out, pixel, float(runner_level(four, bits)) / float(peaks.best))
            validity_out[pixel] = wp.uint8(0)
        else:
            store(disparity_out, pixel, wp.nan)
            store(ratio_out, pixel, 0.0)
            validity_out[pixel] = validity[pixel]
            if validity[pixel] == wp.uint8(0):
                validity_out[pixel] = wp.uint8(OUT_OF_RANGE)
