"""Sum and inverse norm of the window around every pixel: the form for CPUs.

A work-item owns a strip of rows and takes it in blocks of columns, whose sums run down the strip.
"""

import warp as wp

from stereo_gpu.kernels.warp.lanes import LANES, REPEAT, Floats, aligned, floats, load_row, place, put

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

TEXTURELESS = wp.constant(2)
MASKED = wp.constant(16)
BLOCK = wp.constant(256)
LINE = wp.constant(320)  # a block, the largest window and a whole vector
MEMORY = wp.constant(1952)  # six lines and two vectors


@wp.kernel
def window_norms(
    # In:
    picture: wp.array(dtype=float),
    mask: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    radius: int,
    threshold: float,
    rows: int,
    # Out:
    sum_out: wp.array(dtype=float),
    inverse_out: wp.array(dtype=float),
    validity_out: wp.array(dtype=wp.uint8),
):
    """Sum I and 1 / ||I - mean|| over the window, the picture's edge repeated; a work-item is a strip of rows.

    The inverse norm is 0, so that nothing correlates, where the norm is at most threshold (grey levels,
    sqrt of the sum of squares) or the mask is 0.
    """
    strip = wp.tid()
    first = strip * rows
    last = wp.min(first + rows, height)
    count = float((2 * radius + 1) * (2 * radius + 1))
    memory = wp.zeros(shape=(MEMORY,), dtype=float)
    totals = aligned(memory.ptr)
    squares = place(totals, LINE)
    entering = place(squares, LINE)
    leaving = place(entering, LINE)
    total_of = wp.array(ptr=place(leaving, LINE), shape=(LINE,), dtype=float)
    square_of = wp.array(ptr=place(leaving, 2 * LINE), shape=(LINE,), dtype=float)
    for start in range(0, width, BLOCK):
        columns = wp.min(BLOCK, width - start)
        used = columns + 2 * radius
        for k in range(0, used, LANES):
            put(totals, k, Floats(0.0))
            put(squares, k, Floats(0.0))
            put(leaving, k, Floats(0.0))
        for y in range(first - 2 * radius, last):
            row_in = wp.clamp(y + radius, 0, height - 1) * width
            load_row(picture, row_in, start - radius, used, width, 1, REPEAT, entering)
            if y > first:
                # The row that left the window when it moved down to y.
                row_out = wp.clamp(y - radius - 1, 0, height - 1) * width
                load_row(picture, row_out, start - radius, used, width, 1, REPEAT, leaving)
            for k in range(0, used, LANES):
                new = floats(entering, k)
                old = floats(leaving, k)
                put(totals, k, floats(totals, k) + (new - old))
                put(squares, k, floats(squares, k) + (wp.cw_mul(new, new) - wp.cw_mul(old, old)))
            if y >= first:
                for k in range(0, columns, LANES):
                    put(total_of.ptr, k, floats(totals, k))
                    put(square_of.ptr, k, floats(squares, k))
                    for i in range(1, 2 * radius + 1):
                        put(total_of.ptr, k, floats(total_of.ptr, k) + floats(totals, k + i))
                        put(square_of.ptr, k, floats(square_of.ptr, k) + floats(squares, k + i))
                for k in range(columns):
                    pixel = y * width + start + k
                    total = total_of[k]
                    # Sums of whole numbers are exact; their product is not, but the difference of squares
                    # loses little as the values are centred.
                    energy = square_of[k] - total * (total / count)
                    inverse = float(0.0)
                    validity = int(0)
                    if mask[pixel] == wp.uint8(0):
                        validity = MASKED
                    elif energy <= threshold * threshold:
                        validity = TEXTURELESS
                    else:
                        inverse = 1.0 / wp.sqrt(energy)
                    sum_out[pixel] = total
                    inverse_out[pixel] = inverse
                    validity_out[pixel] = wp.uint8(validity)
