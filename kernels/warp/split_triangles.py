"""Which right triangles of the pixel lattice must be split for a mesh to stay close to a disparity map."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def jumps(a: float, b: float, most: float) -> bool:
    """Whether two neighbours differ by more, or one has no value."""
    return not (a - b <= most and b - a <= most)


@wp.func
def is_inside(x: int, y: int, width: int, height: int) -> bool:
    """Whether a pixel lies in the picture."""
    return x >= 0 and y >= 0 and x < width and y < height


@wp.func
def strays(
    disparity: wp.array(dtype=float), at: int, step: int, length: int, value: float, rise: float, error_px: float
) -> bool:
    """Whether a row of pixels lies more than error_px from a line: from `at` on, each `step` places further."""
    found = int(0)
    # To the end of the row, so that loads do not wait for each other: on a GPU that is twice as fast.
    for i in range(length + 1):
        off = disparity[at + i * step] - (value + float(i) * rise)
        found += wp.where(off <= error_px and -off <= error_px, 0, 1)
    return found > 0


@wp.func
def must_split(
    disparity: wp.array(dtype=float),
    corners: wp.array(dtype=float),
    split: wp.array(dtype=wp.uint8),
    x: int,
    y: int,
    along_x: int,
    along_y: int,
    away_x: int,
    away_y: int,
    width: int,
    height: int,
    side: int,
    diagonal: int,
    error_px: float,
    max_jump_px: float,
) -> bool:
    """Whether the triangle with the middle (x, y) of its hypotenuse must be split; see split_triangles."""
    half_side = side // 2
    px = x + along_x
    py = y + along_y
    qx = x - along_x
    qy = y - along_y
    ax = x + away_x
    ay = y + away_y
    if not (is_inside(px, py, width, height) and is_inside(qx, qy, width, height) and is_inside(ax, ay, width, height)):
        # Nothing of the picture is lost with a triangle that lies wholly outside, with at most a side on its edge.
        out_x = wp.min(ax, wp.min(px, qx))
        out_y = wp.min(ay, wp.min(py, qy))
        end_x = wp.max(ax, wp.max(px, qx))
        end_y = wp.max(ay, wp.max(py, qy))
        return out_x < width - 1 and out_y < height - 1 and end_x > 0 and end_y > 0
    p = py * width + px
    q = qy * width + qx
    a = ay * width + ax
    if side == 2 and diagonal == 0:
        middle = disparity[y * width + x]
        if jumps(middle, disparity[p], max_jump_px) or jumps(middle, disparity[q], max_jump_px):
            return True
        if jumps(middle, disparity[a], max_jump_px):
            return True
        if jumps(disparity[a], disparity[p], max_jump_px) or jumps(disparity[a], disparity[q], max_jump_px):
            return True
    else:
        if split[(ay + py) // 2 * width + (ax + px) // 2] != wp.uint8(0):
            return True
        if split[(ay + qy) // 2 * width + (ax + qx) // 2] != wp.uint8(0):
            return True
    # Rows from the right angle's corner along one leg, or from the hypotenuse to the corner, each shorter by `less`.
    one = 1.0 / float(side)
    start = p
    if diagonal != 0:
        start = a
    value = corners[start]
    step = (q - p) // side
    down = step + (a - y * width - x) // half_side
    less = int(2)
    rise = (corners[q] - value) * one
    drop = rise + (corners[a] - 0.5 * (value + corners[q])) * (2.0 * one)
    if diagonal != 0:
        step = (p - a) // side
        down = (q - a) // side
        less = 1
        rise = (corners[p] - value) * one
        drop = (corners[q] - value) * one
    row = int(0)
    length = side
    while length >= 0:
        if strays(disparity, start + row * down, step, length, value + float(row) * drop, rise, error_px):
            return True
        row += 1
        length -= less
    return False


@wp.kernel
def split_triangles(
    # In:
    disparity: wp.array(dtype=float),
    corners: wp.array(dtype=float),
    width: int,
    height: int,
    side: int,
    diagonal: int,
    error_px: float,
    max_jump_px: float,
    # Out:
    split_out: wp.array(dtype=wp.uint8),
):
    """A level of the hierarchy of right triangles (Evans, Kirkpatrick and Townsend 2001).

    Of each pair of triangles that share a hypotenuse, whether they are split at its middle, the pixel (x, y). The
    hypotenuses are the diagonals of squares of side px, which alternate, or with diagonal = 0 the sides of such
    squares. A pair is split where a pixel of either triangle lies more than error_px from the plane through its
    corners, where a pixel has no value, where two neighbours differ by more than max_jump_px, where it reaches out of
    the picture, and where one of the pairs that it is made of is split, so that no corner ends up within another
    triangle's side. From the smallest level on; the other levels' places of split_out are left as they are.
    """
    j, i = wp.tid()
    half_side = side // 2
    upright = j & 1
    # Half of the hypotenuse, and the way from its middle to the corner at the right angle of one of the triangles.
    x = i * side + half_side * (1 - upright)
    y = j * half_side
    along_x = -half_side * (1 - upright)
    along_y = -half_side * upright
    away_x = along_y
    away_y = along_x
    if diagonal != 0:
        sign = 2 * ((i + j) & 1) - 1
        x = i * side + half_side
        y = j * side + half_side
        along_x = sign * half_side
        along_y = -half_side
        away_x = -sign * half_side
        away_y = -half_side
    if x >= width or y >= height:
        return
    found = must_split(
        disparity,
        corners,
        split_out,
        x,
        y,
        along_x,
        along_y,
        away_x,
        away_y,
        width,
        height,
        side,
        diagonal,
        error_px,
        max_jump_px,
    )
    if not found:
        found = must_split(
            disparity,
            corners,
            split_out,
            x,
            y,
            -along_x,
            -along_y,
            -away_x,
            -away_y,
            width,
            height,
            side,
            diagonal,
            error_px,
            max_jump_px,
        )
    split_out[y * width + x] = wp.where(found, wp.uint8(1), wp.uint8(0))
