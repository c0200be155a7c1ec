"""Separable Gaussian prefilter: one launch an axis."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def smooth(
    # In:
    source: wp.array(dtype=float),
    weights: wp.array(dtype=float),
    width: int,
    height: int,
    radius: int,
    axis: int,
    # Out:
    smoothed_out: wp.array(dtype=float),
):
    """Weighted sum of 2 radius + 1 pixels along x (axis 0) or y (axis 1), the picture's edge repeated.

    The second pass (axis 1) rounds to whole grey levels, so that the correlation's sums stay exact.
    """
    y, x = wp.tid()
    total = float(0.0)
    for i in range(2 * radius + 1):
        if axis == 0:
            total += weights[i] * source[y * width + wp.clamp(x + i - radius, 0, width - 1)]
        else:
            total += weights[i] * source[wp.clamp(y + i - radius, 0, height - 1) * width + x]
    if axis == 1:
        total = wp.floor(total + 0.5)
    smoothed_out[y * width + x] = total
