"""Sum and inverse norm of the window around every pixel, and which pixels can be matched at all."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

TEXTURELESS = wp.constant(2)
MASKED = wp.constant(16)


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
    """Sum I and 1 / ||I - mean|| over the window, the picture's edge repeated; a thread is a strip of rows.

    The inverse norm is 0, so that nothing correlates, where the norm is at most threshold (grey levels,
    sqrt of the sum of squares) or the mask is 0.
    """
    strip, x = wp.tid()
    count = float((2 * radius + 1) * (2 * radius + 1))
    total = float(0.0)
    squares = float(0.0)
    first = strip * rows
    for step in range(2 * radius + wp.min(rows, height - first)):
        entering = wp.clamp(first - radius + step, 0, height - 1) * width
        for i in range(-radius, radius + 1):
            value = picture[entering + wp.clamp(x + i, 0, width - 1)]
            total += value
            squares += value * value
        y = first + step - 2 * radius
        if y >= first:
            pixel = y * width + x
            # Sums of whole numbers are exact; their product is not, but the difference of squares
            # loses little as the values are centred.
            energy = squares - total * (total / count)
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
            leaving = wp.clamp(y - radius, 0, height - 1) * width
            for i in range(-radius, radius + 1):
                value = picture[leaving + wp.clamp(x + i, 0, width - 1)]
                total -= value
                squares -= value * value
