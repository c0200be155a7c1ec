"""Census transform: which pixels of a 5 x 5 window are darker than its centre."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def census(
    # In:
    picture: wp.array(dtype=float),
    width: int,
    height: int,
    # Out:
    bits_out: wp.array(dtype=int),
):
    """24 bits, (H, W), in the order of the window, the first one highest; the picture's edge repeated.

    Source: Zabih and Woodfill, ECCV 1994.
    """
    y, x = wp.tid()
    centre = picture[y * width + x]
    bits = int(0)
    for j in range(-2, 3):
        row = wp.clamp(y + j, 0, height - 1) * width
        for i in range(-2, 3):
            if i != 0 or j != 0:
                near = picture[row + wp.clamp(x + i, 0, width - 1)]
                bits = bits * 2 + wp.where(near < centre, 1, 0)
    bits_out[y * width + x] = bits
