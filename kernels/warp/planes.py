"""Fit robust planes through the cells around them."""

import warp as wp

from stereo_gpu.kernels.warp.robust_plane import FIT_ENOUGH, FIT_STIFF, FITS, WIDEST_SCALE, solve

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


# Warp's loop over the grid would take registers for its counters.
@wp.kernel(grid_stride=False)
def planes(
    # In:
    cells: wp.array(dtype=float),
    cells_wide: int,
    cells_high: int,
    planes_wide: int,
    planes_high: int,
    cell: int,
    spacing: int,
    reach: int,
    tolerance: float,
    # Out:
    planes_out: wp.array(dtype=float),
):
    """Least squares planes through the cells within `reach`, one in the middle of each spacing x spacing cells.

    Cells weigh by their own weight and (1 - r^2 / R^2)^3 at a distance of r of R px, and from the second of four fits
    on by (1 / (1 + (e / scale)^2))^2 where they are e px off the plane (Geman and McClure 1987), with scales of 4, 2
    and 1 px. Of each plane its value in its middle, its slopes along x and y, and the weight of the cells within
    tolerance px of it over the weight of all, a plane of the output each; NaN and zeros where no cell is near.
    """
    row, column = wp.tid()
    count = cells_wide * cells_high
    middle_x = column * spacing + spacing // 2
    middle_y = row * spacing + spacing // 2
    side = cell * spacing
    centre_x = float(column * side) + 0.5 * float(side - 1)
    centre_y = float(row * side) + 0.5 * float(side - 1)
    furthest = float(cell * reach)
    inverse = 1.0 / (furthest * furthest)
    stiff = FIT_STIFF * float(cell * cell)
    value = float(0.0)
    along_x = float(0.0)
    along_y = float(0.0)
    sharpness = float(0.0)
    fits = int(1)
    for _ in range(FITS):
        n = float(0.0)
        sum_x = float(0.0)
        sum_y = float(0.0)
        sum_v = float(0.0)
        sum_xx = float(0.0)
        sum_xy = float(0.0)
        sum_yy = float(0.0)
        sum_xv = float(0.0)
        sum_yv = float(0.0)
        if fits == 1:
            for y in range(wp.max(middle_y - reach, 0), wp.min(middle_y + reach + 1, cells_high)):
                for x in range(wp.max(middle_x - reach, 0), wp.min(middle_x + reach + 1, cells_wide)):
                    at = y * cells_wide + x
                    own = cells[at]
                    dx = cells[at + count] - centre_x
                    dy = cells[at + 2 * count] - centre_y
                    near = 1.0 - (dx * dx + dy * dy) * inverse
                    if own > 0.0 and near > 0.0:
                        v = cells[at + 3 * count] - value
                        off = (v - along_x * dx - along_y * dy) * sharpness
                        like = 1.0 / (1.0 + off * off)
                        weight = own * (near * near * near) * (like * like)
                        weighted_x = weight * dx
                        weighted_y = weight * dy
                        n += weight
                        sum_x += weighted_x
                        sum_y += weighted_y
                        sum_v += weight * v
                        sum_xx += weighted_x * dx
                        sum_xy += weighted_x * dy
                        sum_yy += weighted_y * dy
                        sum_xv += weighted_x * v
                        sum_yv += weighted_y * v
        if n > FIT_ENOUGH:
            plane = solve(value, n, sum_x, sum_y, sum_v, sum_xx, sum_xy, sum_yy, sum_xv, sum_yv, stiff)
            value = plane[0]
            along_x = plane[1]
            along_y = plane[2]
        else:
            fits = 0
        sharpness = wp.where(sharpness > 0.0, 2.0 * sharpness, 1.0 / WIDEST_SCALE)
    whole = float(0.0)
    on_it = float(0.0)
    if fits == 1:
        for y in range(wp.max(middle_y - reach, 0), wp.min(middle_y + reach + 1, cells_high)):
            for x in range(wp.max(middle_x - reach, 0), wp.min(middle_x + reach + 1, cells_wide)):
                at = y * cells_wide + x
                own = cells[at]
                dx = cells[at + count] - centre_x
                dy = cells[at + 2 * count] - centre_y
                near = 1.0 - (dx * dx + dy * dy) * inverse
                if own > 0.0 and near > 0.0:
                    weight = own * (near * near * near)
                    whole += weight
                    if wp.abs(cells[at + 3 * count] - value - along_x * dx - along_y * dy) <= tolerance:
                        on_it += weight
    out = row * planes_wide + column
    number = planes_wide * planes_high
    planes_out[out] = wp.where(fits == 1, value, wp.nan)
    planes_out[out + number] = wp.where(fits == 1, along_x, 0.0)
    planes_out[out + 2 * number] = wp.where(fits == 1, along_y, 0.0)
    planes_out[out + 3 * number] = wp.where(fits == 1, on_it / whole, 0.0)
