"""Semi-global aggregation along the lines of one direction (Hirschmueller, PAMI 2008, section 2.3)."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

NO_MATCH = wp.constant(255)
UNSEEN = wp.constant(254)
UNSEEN_COST = wp.constant(20.0)
LARGEST_COST = wp.constant(62.0)


@wp.kernel
def aggregate(
    # In:
    cost: wp.array(dtype=wp.uint8),
    picture: wp.array(dtype=float),
    width: int,
    height: int,
    disparities: int,
    step_x: int,
    step_y: int,
    row_slope: int,
    small_penalty: float,
    large_penalty: float,
    edge_penalty: float,
    edge: float,
    weight: float,
    lines: int,
    scratch: wp.array(dtype=float),
    # Out:
    volume_out: wp.array(dtype=float),
):
    """Add to volume_out how much cheaper than the dearest path each disparity's path is, times weight.

    L(p, d) = C(p, d) + min(L(q, e), L(q, e +- 1) + small_penalty, min L(q) + P) - min L(q) with q = p - step and
    e = d - row_slope step_y: a surface whose disparity grows by row_slope a row pays nothing for that
    (Scharstein, Taniai, Sinha, 3DV 2017).
    P is large_penalty, or edge_penalty where the picture changes by more than edge grey levels from q to p:
    depth jumps at edges. A thread walks one line; scratch holds L of the last two pixels, 2 x D a line. UNSEEN
    costs UNSEEN_COST, less than a false match, so that a surface goes on where only the other picture ends.
    NO_MATCH costs LARGEST_COST and adds nothing at its own pixel.
    """
    line = wp.tid()
    x = int(0)
    y = int(0)
    # Lines start on the row that the step leads away from, then on the column.
    if step_y != 0 and line < width:
        x = line
        y = wp.where(step_y > 0, 0, height - 1)
    else:
        x = wp.where(step_x > 0, 0, width - 1)
        y = line
        if step_y != 0:
            y = line - width + wp.where(step_y > 0, 1, 0)
    before = line * 2 * disparities
    now = before + disparities
    cheapest = float(0.0)
    value = picture[y * width + x]
    first = int(1)
    while x >= 0 and x < width and y >= 0 and y < height:
        pixel = y * width + x
        penalty = large_penalty
        if wp.abs(picture[pixel] - value) > edge:
            penalty = edge_penalty
        value = picture[pixel]
        next_cheapest = float(1.0e9)
        for i in range(disparities):
            own = int(cost[pixel * disparities + i])
            path = wp.min(float(own), LARGEST_COST)
            if own == UNSEEN:
                path = UNSEEN_COST
            if first == 0:
                best = cheapest + penalty
                from_index = i - row_slope * step_y
                if from_index >= 0 and from_index < disparities:
                    best = wp.min(best, scratch[before + from_index])
                if from_index > 0 and from_index <= disparities:
                    best = wp.min(best, scratch[before + from_index - 1] + small_penalty)
                if from_index >= -1 and from_index < disparities - 1:
                    best = wp.min(best, scratch[before + from_index + 1] + small_penalty)
                path += best - cheapest
            scratch[now + i] = path
            next_cheapest = wp.min(next_cheapest, path)
            if own != NO_MATCH:
                volume_out[pixel * disparities + i] += (LARGEST_COST + large_penalty + 1.0 - path) * weight
        cheapest = next_cheapest
        first = 0
        swap = before
        before = now
        now = swap
        x += step_x
        y += step_y
