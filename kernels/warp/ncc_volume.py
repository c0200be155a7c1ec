"""Zero-mean normalized cross-correlation of every pixel at every disparity."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def row_product(
    reference: wp.array(dtype=float),
    other: wp.array(dtype=float),
    row: int,
    x: int,
    u: int,
    width: int,
    radius: int,
) -> float:
    """Sum over one row of the window of reference(x + i) other(u + i), the picture's edge repeated."""
    total = float(0.0)
    for i in range(-radius, radius + 1):
        total += reference[row + wp.clamp(x + i, 0, width - 1)] * other[row + wp.clamp(u + i, 0, width - 1)]
    return total


@wp.kernel
def ncc_volume(
    # In:
    reference: wp.array(dtype=float),
    other: wp.array(dtype=float),
    reference_sum: wp.array(dtype=float),
    reference_inverse: wp.array(dtype=float),
    other_sum: wp.array(dtype=float),
    other_inverse: wp.array(dtype=float),
    width: int,
    height: int,
    smallest: int,
    disparities: int,
    radius: int,
    direction: int,
    rows: int,
    # Out:
    volume_out: wp.array(dtype=float),
):
    """NCC of reference(x, y) with other(x + direction d, y), (H, W, D) with d fastest; 0 where there is none.

    direction is 1 for the right view as reference and -1 for the left one. A thread is one disparity of
    one column over a strip of rows; the box sum runs down the strip.
    """
    strip, x, i = wp.tid()
    u = x + direction * (smallest + i)
    count = float((2 * radius + 1) * (2 * radius + 1))
    first = strip * rows
    box = float(0.0)
    for step in range(2 * radius + wp.min(rows, height - first)):
        entering = wp.clamp(first - radius + step, 0, height - 1) * width
        box += row_product(reference, other, entering, x, u, width, radius)
        y = first + step - 2 * radius
        if y >= first:
            pixel = y * width + x
            score = float(0.0)
            if u >= 0 and u < width:
                # This order of operations is the same in every form of the correlation, so that all agree.
                score = (
                    (box - (reference_sum[pixel] / count) * other_sum[y * width + u]) * reference_inverse[pixel]
                ) * other_inverse[y * width + u]
            volume_out[pixel * disparities + i] = score
            leaving = wp.clamp(y - radius, 0, height - 1) * width
            box -= row_product(reference, other, leaving, x, u, width, radius)
