"""How fast a GPU multiplies and adds: the roof that the benchmark holds the other kernels against."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def multiply_add(
    # In:
    width: int,
    height: int,
    rounds: int,
    factor: float,
    summand: float,
    # Out:
    sum_out: wp.array(dtype=float),
):
    """Eight chains v = v * factor + summand, begun at the pixel's number + 0 to 7, after so many rounds; their sum.

    Chains hide each other's latency. The two operations stay unfused, as in every kernel here.
    """
    y, x = wp.tid()
    item = y * width + x
    a = float(item)
    b = a + 1.0
    c = a + 2.0
    d = a + 3.0
    e = a + 4.0
    f = a + 5.0
    g = a + 6.0
    h = a + 7.0
    for _ in range(rounds):
        a = a * factor + summand
        b = b * factor + summand
        c = c * factor + summand
        d = d * factor + summand
        e = e * factor + summand
        f = f * factor + summand
        g = g * factor + summand
        h = h * factor + summand
    sum_out[item] = ((a + b) + (c + d)) + ((e + f) + (g + h))
