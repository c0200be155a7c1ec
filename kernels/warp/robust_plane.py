"""A plane through the cells around it that are not led astray by those of other surfaces."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FITS = wp.constant(4)  # the first one takes all cells alike, then those far off the plane weigh ever less
WIDEST_SCALE = wp.constant(4.0)  # px: of the second fit; half of it with each further one (graduated non-convexity)
FIT_ENOUGH = wp.constant(1.0e-6)  # sum of weights: less tells no plane
FIT_STIFF = wp.constant(0.25)  # pulls the slopes towards 0, in squared cells: cells on a line tell none across it
STEEPEST = wp.constant(1.0)  # slope, px a pixel


@wp.func
def solve(
    value: float,
    n: float,
    sum_x: float,
    sum_y: float,
    sum_v: float,
    sum_xx: float,
    sum_xy: float,
    sum_yy: float,
    sum_xv: float,
    sum_yv: float,
    stiff: float,
) -> wp.vec3:
    """Value and slopes that the weighted sums tell, whose disparities are relative to `value`."""
    one = 1.0 / n
    mean_x = sum_x * one
    mean_y = sum_y * one
    xx = sum_xx - sum_x * mean_x + stiff * n
    yy = sum_yy - sum_y * mean_y + stiff * n
    xy = sum_xy - sum_x * mean_y
    xv = sum_xv - sum_v * mean_x
    yv = sum_yv - sum_v * mean_y
    area = xx * yy - xy * xy
    along_x = wp.clamp((xv * yy - yv * xy) / area, -STEEPEST, STEEPEST)
    along_y = wp.clamp((yv * xx - xv * xy) / area, -STEEPEST, STEEPEST)
    return wp.vec3(value + (sum_v * one - along_x * mean_x - along_y * mean_y), along_x, along_y)


@wp.func
def fit_plane(
    cells: wp.array(dtype=float),
    cells_wide: int,
    cells_high: int,
    planes_wide: int,
    planes_high: int,
    column: int,
    row: int,
    cell: int,
    spacing: int,
    reach: int,
    tolerance: float,
    planes_out: wp.array(dtype=float),
):
    """One plane; see planes.py. Sums take the rows one after another, each from left to right."""
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
