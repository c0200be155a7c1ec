"""Refine disparities by correlating windows that lean with the surface: the form for CPUs.

A work-item takes a row. What the three correlations of a pixel have in common is computed once.
"""

import warp as wp

from stereo_gpu.kernels.warp.slant import SAME_SURFACE, fit_plane, slope, step_to_peak

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def leaning_nccs(
    reference: wp.array(dtype=float),
    other: wp.array(dtype=float),
    disparity: wp.array(dtype=float),
    x: int,
    y: int,
    plane: wp.vec3,
    step: float,
    width: int,
    height: int,
    radius: int,
    direction: float,
) -> wp.vec3:
    """NCC of the pixels around (x, y) that lie on a plane of disparity, with the plane moved by -step, 0 and step px.

    Pixels whose own disparity is further than SAME_SURFACE from the plane belong to another surface. 0 where
    the window is flat or holds less than a third of its pixels: a handful correlates with anything.
    """
    count = float(0.0)
    sum_a = float(0.0)
    sum_aa = float(0.0)
    sum_b = wp.vec3()
    sum_bb = wp.vec3()
    sum_ab = wp.vec3()
    for j in range(-radius, radius + 1):
        row = wp.clamp(y + j, 0, height - 1) * width
        i = int(-radius)
        while i <= radius:
            at = row + wp.clamp(x + i, 0, width - 1)
            surface = plane[0] + plane[1] * float(i) + plane[2] * float(j)
            if wp.abs(disparity[at] - surface) <= SAME_SURFACE:
                a = reference[at]
                count += 1.0
                sum_a += a
                sum_aa += a * a
                for k in range(3):
                    # Counted from x, so that a part of a picture rounds as the whole of it.
                    u = float(i) + direction * (surface + float(k - 1) * step)
                    left = wp.floor(u)
                    share = u - left
                    column = x + int(left)
                    # Few windows reach the edge: a test is cheaper than two clamps.
                    beside = row + column
                    next_one = beside + 1
                    if column < 0 or column >= width - 1:
                        beside = row + wp.clamp(column, 0, width - 1)
                        next_one = row + wp.clamp(column + 1, 0, width - 1)
                    b = other[beside] * (1.0 - share) + other[next_one] * share
                    sum_b[k] += b
                    sum_bb[k] += b * b
                    sum_ab[k] += a * b
            i += 1
    window = float((2 * radius + 1) * (2 * radius + 1))
    result = wp.vec3()
    for k in range(3):
        energy = (sum_aa - sum_a * sum_a / count) * (sum_bb[k] - sum_b[k] * sum_b[k] / count)
        if energy > 1.0 and count * 3.0 >= window:
            result[k] = (sum_ab[k] - sum_a * sum_b[k] / count) / wp.sqrt(energy)
    return result


@wp.kernel
def slant(
    # In:
    reference: wp.array(dtype=float),
    other: wp.array(dtype=float),
    disparity: wp.array(dtype=float),
    width: int,
    height: int,
    radius: int,
    direction: int,
    step: float,
    largest_slope: float,
    # Out:
    disparity_out: wp.array(dtype=float),
    score_out: wp.array(dtype=float),
):
    """Move each disparity to the peak of the NCC over step px around it, with windows that follow the surface.

    The window leans with the plane through the map around it; a slope of more than largest_slope px a pixel is
    a depth jump. The peak is a parabola's through three scores, at most step px from the plane. score_out is
    the NCC there; where it is under SURE noise would decide, and the plane stands.
    """
    y = wp.tid()
    # Arrays whose elements are known to lie side by side are faster to read.
    ours = wp.array(ptr=reference.ptr, shape=(1,), dtype=float)
    theirs = wp.array(ptr=other.ptr, shape=(1,), dtype=float)
    given = wp.array(ptr=disparity.ptr, shape=(1,), dtype=float)
    for x in range(width):
        pixel = y * width + x
        value = disparity[pixel]
        disparity_out[pixel] = value
        score_out[pixel] = 0.0
        if wp.isnan(value):
            continue
        along_x = slope(given, y * width, x, width, 1, largest_slope)
        along_y = slope(given, x, y, height, width, largest_slope)
        plane = fit_plane(given, x, y, along_x, along_y, width, height)
        way = float(direction)
        scores = leaning_nccs(ours, theirs, given, x, y, plane, step, width, height, radius, way)
        peak = step_to_peak(scores[0], scores[1], scores[2])
        disparity_out[pixel] = plane[0] + peak[0] * step
        score_out[pixel] = wp.max(peak[1], 0.0)
