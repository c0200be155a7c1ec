"""Step from nearly right disparities to where both pictures fit, and how much they say about it."""

import warp as wp

from stereo_gpu.kernels.warp.likeness import UNLIKE, likeness

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

EVIDENCE_ENOUGH = wp.constant(3.0)  # sum of weights; fewer samples tell nothing
UNKNOWN = wp.constant(1.0e6)  # residual variance where there is no evidence


@wp.func
def sample_weight(guide: wp.array(dtype=wp.uint8), pixels: int, here: int, there: int) -> float:
    """How much a sample weighs, by the guide's planes of `pixels` bytes each."""
    difference = wp.abs(int(guide[here]) - int(guide[there]))
    difference += wp.abs(int(guide[here + pixels]) - int(guide[there + pixels]))
    difference += wp.abs(int(guide[here + 2 * pixels]) - int(guide[there + 2 * pixels]))
    if difference >= UNLIKE:
        return 0.0
    return likeness(UNLIKE - difference)


@wp.func
def settled(
    value: float,
    n: float,
    sum_g: float,
    sum_e: float,
    sum_gg: float,
    sum_ge: float,
    sum_ee: float,
    way: float,
    noise: float,
    damping: float,
    largest_step: float,
    keep: float,
) -> wp.vec3:
    """Where a value moves to, the information and the residual, from weighted sums of rises g and differences e."""
    if not (n >= EVIDENCE_ENOUGH):
        return wp.vec3(value, 0.0, UNKNOWN)
    gg = wp.max(sum_gg - sum_g * sum_g / n, 0.0)  # rounding alone takes it below
    ge = sum_ge - sum_g * sum_e / n
    ee = sum_ee - sum_e * sum_e / n
    step = wp.clamp(way * ge / (gg + damping * noise), -largest_step, largest_step)
    residual = wp.max(ee - 2.0 * way * step * ge + step * step * gg, 0.0) / n
    information = gg / (2.0 * noise + residual)
    certain = float(0.0)
    if information > 0.0:
        certain = information / (information + keep)
    return wp.vec3(value + step * certain, information, residual)


@wp.func
def evidence_at(
    reference: wp.array(dtype=float),
    other: wp.array(dtype=float),
    guide: wp.array(dtype=wp.uint8),
    x: int,
    y: int,
    value: float,
    slope_x: float,
    slope_y: float,
    width: int,
    height: int,
    radius: int,
    direction: int,
    weighted: int,
    noise: float,
    damping: float,
    largest_step: float,
    keep: float,
) -> wp.vec3:
    """Where a pixel of this disparity and slopes moves to, the information and the residual; see the kernel."""
    pixel = y * width + x
    way = float(direction)
    n = float(0.0)
    sum_g = float(0.0)
    sum_e = float(0.0)
    sum_gg = float(0.0)
    sum_ge = float(0.0)
    sum_ee = float(0.0)
    for j in range(-radius, radius + 1):
        if y + j >= 0 and y + j < height:
            row = (y + j) * width
            across_row = value + slope_y * float(j)
            for i in range(-radius, radius + 1):
                near = x + i
                # Counted from x, so that a part of a picture rounds as the whole of it.
                u = float(i) + way * (across_row + slope_x * float(i))
                left = int(u)
                if float(left) > u:
                    left -= 1
                column = x + left
                if near >= 1 and near <= width - 2 and column >= 1 and column <= width - 3:
                    share = u - float(left)
                    rest = 1.0 - share
                    t0 = other[row + column - 1]
                    t1 = other[row + column]
                    t2 = other[row + column + 1]
                    t3 = other[row + column + 2]
                    rise = 0.5 * ((t2 - t0) * rest + (t3 - t1) * share)
                    at = row + near
                    g = 0.5 * (rise + 0.5 * (reference[at + 1] - reference[at - 1]))
                    e = reference[at] - (t1 * rest + t2 * share)
                    weight = float(1.0)
                    if weighted != 0:
                        weight = sample_weight(guide, width * height, pixel, at)
                    weighted_g = weight * g
                    weighted_e = weight * e
                    n += weight
                    sum_g += weighted_g
                    sum_e += weighted_e
                    sum_gg += weighted_g * g
                    sum_ge += weighted_g * e
                    sum_ee += weighted_e * e
    return settled(value, n, sum_g, sum_e, sum_gg, sum_ge, sum_ee, way, noise, damping, largest_step, keep)


# Half of a multiprocessor's threads at least; Warp's loop over the grid would take registers for its counters.
@wp.kernel(launch_bounds=(256, 4), grid_stride=False)
def evidence(
    # In:
    reference: wp.array(dtype=float),
    other: wp.array(dtype=float),
    disparity: wp.array(dtype=float),
    along_x: wp.array(dtype=float),
    along_y: wp.array(dtype=float),
    guide: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    radius: int,
    stride: int,
    direction: int,
    weighted: int,
    noise: float,
    damping: float,
    largest_step: float,
    keep: float,
    # Out:
    moved_out: wp.array(dtype=float),
    information_out: wp.array(dtype=float),
    residual_out: wp.array(dtype=float),
):
    """One damped Gauss-Newton step (Lucas and Kanade 1981) over the (2 radius + 1)^2 pixels around.

    Their disparities lean by along_x and along_y px a pixel, and the mean difference of grey levels is removed. The
    gradient is the mean of both pictures' central differences. Samples weigh by how much they look like the pixel in
    the guide, three planes of bytes, where `weighted`, else all the same; those without all their neighbours in both
    rows do not count. residual_out is the variance of the difference after the step; information_out, the inverse of
    the step's variance, the energy of the gradients over that variance and twice `noise`, which is more than 0. The
    step is at most largest_step px, and shrinks by information / (information + keep). Where x or y is no multiple of
    stride, where there is no disparity or where the weights sum up to less than EVIDENCE_ENOUGH, the disparity stays,
    with information 0 and residual UNKNOWN.
    """
    y, x = wp.tid()
    pixel = y * width + x
    value = disparity[pixel]
    found = wp.vec3(value, 0.0, UNKNOWN)
    if not wp.isnan(value) and x % stride == 0 and y % stride == 0:
        found = evidence_at(
            reference,
            other,
            guide,
            x,
            y,
            value,
            along_x[pixel],
            along_y[pixel],
            width,
            height,
            radius,
            direction,
            weighted,
            noise,
            damping,
            largest_step,
            keep,
        )
    moved_out[pixel] = found[0]
    information_out[pixel] = found[1]
    residual_out[pixel] = found[2]
