"""Few triangles that stay within an error of a disparity map: right triangles on the pixel lattice."""

from __future__ import annotations

import numpy as np

from stereo_gpu.backends import Backend, DeviceArray
from stereo_gpu.meshing.cell_triangles import cell_triangles, half_cells, join
from stereo_gpu.types import Bytes, Floats, Ints

LARGEST_SIDE = 64  # of the squares that the first triangles are halves of, px
# Corners: how far from a plane the pixels around it may lie, px, and what share of the error may go into a corner.
WIDEST_FIT = 0.75
SETTLED = 0.95


def bounded_triangles(
    device: Backend, values: Floats, *, error_px: float, max_jump_px: float, infinity_px: float = 0.0
) -> tuple[Ints, Floats]:
    """Cover a disparity map with right triangles, as large as its shape allows.

    The lattice is cut into squares of LARGEST_SIDE px, each into two right isosceles triangles, and a triangle into two
    at the middle of its hypotenuse, down to half of the square between four pixels (W. Evans, D. Kirkpatrick and G.
    Townsend, "Right-Triangulated Irregular Networks", Algorithmica 30, 2001). Both triangles at a hypotenuse are split
    or neither, so that no corner lies within a side. Opposite the sides stand angles of 45 and 90 degrees: the mesh is
    Delaunay. A triangle is linear in disparity over the picture, which is a plane in space, too.

    Corners do not take the noise of their own pixel: each lies on the plane through the 5 x 5 pixels around it, as far
    as the error allows. That takes most slivers away that noise makes of the smallest triangles.

    Args:
        device: where the errors are computed.
        values: (H, W) float32 disparity, px; NaN where there is none.
        error_px: largest distance of a triangle from the value of any pixel in it.
        max_jump_px: no triangle holds two neighbouring pixels that differ by more than this.
        infinity_px: disparity of a point at infinity, which no corner is moved to.

    Returns:
        (M, 3) faces over flat pixel indices, counter-clockwise as seen, from the corner at the right angle on; and
        (H, W) float32, the disparity of a corner in each pixel.
    """
    held = device.upload(values)
    settled = _settle(device, held, values, error_px, infinity_px)
    split = _split(device, held, device.upload(settled), error_px, max_jump_px)
    parts = []
    side = 2
    while side <= LARGEST_SIDE:
        parts += [*_quarters(split, side), *_halves(split, side)]
        side *= 2
    return join([*parts, *_smallest(values, split, max_jump_px)]), settled


def _settle(device: Backend, held: DeviceArray, values: Floats, error_px: float, infinity_px: float) -> Floats:
    """(H, W): each pixel's disparity on the plane around it, hardly less than `error_px` from its own at most."""
    height, width = values.shape
    fitted = device.empty(values.shape, np.float32)
    device.launch(
        "plane_fit",
        disparity=held,
        validity=device.zeros(values.shape, np.uint8),
        guide=device.zeros((3, *values.shape), np.uint8),
        width=width,
        height=height,
        reach=2,
        step=1,
        tolerance=min(WIDEST_FIT, 3 * error_px),
        slope=0.3,
        largest_slope=3.0,
        disparity_out=fitted,
    )
    most = np.float32(SETTLED * error_px)
    settled = np.clip(device.download(fitted), values - most, values + most)
    # Half of the way to infinity is as far as a corner may go.
    return np.asarray(np.maximum(settled, 0.5 * (values + np.float32(infinity_px))), np.float32)


def _split(device: Backend, held: DeviceArray, corners: DeviceArray, error_px: float, max_jump_px: float) -> Bytes:
    """(H, W): 1 where a hypotenuse is split at this pixel; also at the corners of the largest squares."""
    height, width = held.shape
    split = device.empty(held.shape, np.uint8)
    side = 2
    while side <= LARGEST_SIDE:
        for diagonal in (0, 1):
            device.launch(
                "split_triangles",
                disparity=held,
                corners=corners,
                width=width,
                height=height,
                side=side,
                diagonal=diagonal,
                error_px=error_px,
                max_jump_px=max_jump_px,
                split_out=split,
            )
        side *= 2
    found = np.array(device.download(split))
    found[::LARGEST_SIDE, ::LARGEST_SIDE] = 1
    return found


def _quarters(split: Bytes, side: int) -> list[Ints]:
    """Triangles with a side of a square as their hypotenuse, and the square's middle as their third corner."""
    height, width = split.shape
    h = side // 2
    found = []
    # Where the middle is split, and the side is not; by the way from the middle to the side.
    middle = split[h::side, h::side] != 0
    for x, y in ((0, -h), (0, h), (-h, 0), (h, 0)):
        of_side = split[h + y :: side, h + x :: side]
        rows, columns = min(middle.shape[0], of_side.shape[0]), min(middle.shape[1], of_side.shape[1])
        j, i = np.nonzero(middle[:rows, :columns] & (of_side[:rows, :columns] == 0))
        # Ends of the side, so that with the middle they go round counter-clockwise.
        row, column = j * side + h, i * side + h
        p_row, p_column, q_row, q_column = row + y + x, column + x - y, row + y - x, column + x + y
        inside = np.ones(len(row), bool)
        for r, c in ((p_row, p_column), (q_row, q_column)):
            inside &= (r < height) & (c < width)
        face = [row * width + column, p_row * width + p_column, q_row * width + q_column]
        found.append(np.stack([index[inside] for index in face], axis=1).astype(np.int32))
    return found


def _halves(split: Bytes, side: int) -> list[Ints]:
    """Triangles with the diagonal of a square as their hypotenuse."""
    height, width = split.shape
    rows, columns = (height - 1) // side, (width - 1) // side
    if not (rows and columns):
        return []
    whole = split[side // 2 :: side, side // 2 :: side][:rows, :columns] == 0
    falls = (np.arange(rows)[:, None] + np.arange(columns)) % 2 == 0
    found = []
    for corner in range(4):
        at_corner = split[(corner // 2) * side :: side, (corner % 2) * side :: side][:rows, :columns] != 0
        j, i = np.nonzero(whole & at_corner & (falls == (corner in (1, 2))))
        a = (j * side * width + i * side).astype(np.int32)
        offsets = (0, side, side * width, side * width + side)
        order = ((0, 2, 1), (1, 0, 3), (2, 3, 0), (3, 1, 2))[corner]
        found.append(np.stack([a + np.int32(offsets[k]) for k in order], axis=1))
    return found


def _smallest(values: Floats, split: Bytes, max_jump_px: float) -> list[Ints]:
    """Triangles of single cells: of those whose halves both are left, along the better diagonal."""
    height, width = split.shape
    is_split = split != 0
    a, b, c, d = is_split[:-1, :-1], is_split[:-1, 1:], is_split[1:, :-1], is_split[1:, 1:]
    number = np.arange(height * width, dtype=np.int32).reshape(height, width)[:-1, :-1]
    falls = np.zeros((height - 1, width - 1), bool)
    falls[::2, ::2] = True
    falls[1::2, 1::2] = True
    both = np.where(falls, b & c, a & d)
    found = [cell_triangles(values, number[both], max_jump_px)]
    for corner, (one, other, mine) in enumerate(((a, d, ~falls), (b, c, falls), (c, b, falls), (d, a, ~falls))):
        found.append(half_cells(values, number[one & ~other & mine], corner, max_jump_px))
    return found
