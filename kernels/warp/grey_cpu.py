"""Luma of a picture, centred and in whole steps: the form for CPUs, whose work-items take a row each, in blocks."""

from typing import Any

import warp as wp

from stereo_gpu.kernels.warp.lanes import LANES, Floats, Ints, aligned, floats, place, put, put_some

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BLOCK = wp.constant(256)
MEMORY = wp.constant(800)  # three blocks and two vectors


@wp.kernel
def grey(
    # In:
    picture: wp.array(dtype=Any),
    width: int,
    height: int,
    channels: int,
    black: float,
    scale: float,
    # Out:
    grey_out: wp.array(dtype=float),
):
    """Rec. 601 luma above black, times scale, rounded to whole grey levels 0..255, minus 128."""
    y = wp.tid()
    memory = wp.zeros(shape=(MEMORY,), dtype=float)
    red = aligned(memory.ptr)
    green = place(red, BLOCK)
    blue = place(green, BLOCK)
    red_at = wp.array(ptr=red, shape=(BLOCK,), dtype=float)
    green_at = wp.array(ptr=green, shape=(BLOCK,), dtype=float)
    blue_at = wp.array(ptr=blue, shape=(BLOCK,), dtype=float)
    for start in range(0, width, BLOCK):
        columns = wp.min(BLOCK, width - start)
        first = y * width + start
        # An array whose elements are known to lie side by side is faster to read.
        pixels = wp.array(ptr=picture.ptr, shape=(3,), dtype=picture.dtype)
        k = int(0)
        if channels == 1:
            while k < columns:
                red_at[k] = float(pixels[first + k])
                k += 1
        else:
            while k < columns:
                red_at[k] = float(pixels[(first + k) * channels])
                green_at[k] = float(pixels[(first + k) * channels + 1])
                blue_at[k] = float(pixels[(first + k) * channels + 2])
                k += 1
            for i in range(0, columns, LANES):
                put(red, i, 0.299 * floats(red, i) + 0.587 * floats(green, i) + 0.114 * floats(blue, i))
        for i in range(0, columns, LANES):
            # Whole numbers keep every sum of products of the correlation exact in float32. None is below 0.
            level = wp.max((floats(red, i) - Floats(black)) * scale, Floats(0.0))
            level = wp.min(level, Floats(255.0)) + Floats(0.5)
            put(red, i, Floats(Ints(level)) - Floats(128.0))
            put_some(grey_out, first + i, first + columns, place(red, i))
