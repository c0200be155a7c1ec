"""Gather what pixels say of a surface into square cells."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

LEAST_VARIANCE = wp.constant(0.01)  # px^2: added to the variance that the pictures' noise alone would give


@wp.kernel
def cells(
    # In:
    moved: wp.array(dtype=float),
    information: wp.array(dtype=float),
    width: int,
    height: int,
    cell: int,
    least: float,
    # Out:
    cells_out: wp.array(dtype=float),
):
    """Of each cell of cell x cell pixels: total weight, and weighted means of columns, rows and disparities.

    A plane of the output each; zeros where no pixel counts. A pixel of a value counts from an information of `least`
    (1 / px^2) on, and weighs by it. Columns of pixels are summed up first, each downwards.
    """
    row, column = wp.tid()
    cells_wide = (width - 1) // cell + 1
    cells_high = (height - 1) // cell + 1
    left = column * cell
    top = row * cell
    n = float(0.0)
    sum_x = float(0.0)
    sum_y = float(0.0)
    sum_v = float(0.0)
    for i in range(wp.min(cell, width - left)):
        column_n = float(0.0)
        column_y = float(0.0)
        column_v = float(0.0)
        for j in range(wp.min(cell, height - top)):
            pixel = (top + j) * width + left + i
            value = moved[pixel]
            told = information[pixel]
            if not wp.isnan(value) and told >= least:
                weight = 1.0 / (1.0 / told + LEAST_VARIANCE)
                column_n += weight
                column_y += weight * float(j)
                column_v += weight * value
        n += column_n
        sum_x += column_n * float(i)
        sum_y += column_y
        sum_v += column_v
    out = row * cells_wide + column
    plane = cells_wide * cells_high
    some = n > 0.0
    cells_out[out] = n
    cells_out[out + plane] = wp.where(some, float(left) + sum_x / n, 0.0)
    cells_out[out + 2 * plane] = wp.where(some, float(top) + sum_y / n, 0.0)
    cells_out[out + 3 * plane] = wp.where(some, sum_v / n, 0.0)
