"""Census transform: which pixels of a 9 x 7 window are darker than its centre."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def census(
    # In:
    picture: wp.array(dtype=float),
    width: int,
    height: int,
    row_shift: int,
    # Out:
    bits_out: wp.array(dtype=int),
):
    """62 bits in two numbers of 31, (H, W, 2), the picture's edge repeated (Zabih and Woodfill, ECCV 1994).

    Each row of the window lies row_shift px further right than the one above it: how the other view sees the
    square window of a surface whose disparity changes by so much a row.
    """
    y, x = wp.tid()
    centre = picture[y * width + x]
    upper = int(0)
    lower = int(0)
    for k in range(31):
        # Pixel k of the first half in reading order, and its mirror image through the centre.
        row = k // 9 - 3
        column = k % 9 - 4 + row_shift * row
        first = picture[wp.clamp(y + row, 0, height - 1) * width + wp.clamp(x + column, 0, width - 1)]
        mirrored = picture[wp.clamp(y - row, 0, height - 1) * width + wp.clamp(x - column, 0, width - 1)]
        upper = upper * 2 + wp.where(first < centre, 1, 0)
        lower = lower * 2 + wp.where(mirrored < centre, 1, 0)
    bits_out[(y * width + x) * 2] = upper
    bits_out[(y * width + x) * 2 + 1] = lower
