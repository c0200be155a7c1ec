"""Which triangles of a mesh on the pixel lattice hang together, and how much of the picture they cover."""

from __future__ import annotations

import cv2
import numpy as np

from stereo_gpu.types import Floats, Ints


def number_parts(faces: Ints, shape: tuple[int, ...]) -> Ints:
    """Number the connected parts of a mesh: faces that share a corner are of one part.

    The legs of every face are drawn on a lattice of twice the size, and the connected components of that picture are
    then the mesh's: much faster than a search through a graph. Lines meet there only where faces share a corner.

    Args:
        faces: (M, 3) over flat pixel indices; each is a right isosceles triangle on the lattice, its sides along rows,
            columns and diagonals, from the corner at the right angle on.
        shape: (H, W) of the lattice.

    Returns:
        (M,) numbers from 1 on.
    """
    height, width = shape
    broad = 2 * width - 1
    drawn = np.zeros((2 * height - 1, broad), np.uint8)
    flat = drawn.ravel()
    row, column = np.divmod(faces, np.int32(width))
    start = 2 * row[:, 0] * broad + 2 * column[:, 0]
    flat[start] = 1
    down, right = row[:, 1:] - row[:, :1], column[:, 1:] - column[:, :1]
    length = np.maximum(abs(down[:, 0]), abs(right[:, 0]))
    for steps in np.unique(length):
        of = np.flatnonzero(length == steps)
        for leg in range(2):
            stride = (down[of, leg] * broad + right[of, leg]) // steps
            at = start[of]
            for _ in range(2 * steps):
                at = at + stride
                flat[at] = 1
    _, label = cv2.connectedComponents(drawn, connectivity=8, ltype=cv2.CV_32S)
    return np.asarray(label.ravel()[start], np.int32)


def number_sheets(faces: Ints, shape: tuple[int, ...]) -> Ints:
    """Number the sheets of a mesh: faces that share a side, not a corner alone, are of one.

    Args:
        faces: (M, 3) over flat pixel indices, none over another, and no corner within another's side.
        shape: (H, W) of the lattice.

    Returns:
        (M,) numbers from 0 on.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    height, width = shape
    row, column = np.divmod(faces, np.int32(width))
    # Sides do not cross, so that each is known by its middle, which lies on the lattice of twice the size.
    middle = (row + np.roll(row, -1, axis=1)) * (2 * width - 1) + column + np.roll(column, -1, axis=1)
    number = np.arange(len(faces), dtype=np.int32)
    one_at = np.empty((2 * height - 1) * (2 * width - 1), np.int32)
    for side in middle.T:
        one_at[side] = number
    pairs = number.repeat(3), one_at[middle.ravel()]
    joined = coo_array((np.ones(len(pairs[0]), bool), pairs), shape=(len(faces), len(faces)))
    return np.asarray(connected_components(joined, directed=False)[1], np.int32)


def covered_pixels(faces: Ints, shape: tuple[int, ...]) -> Floats:
    """(M,): area of each face of `number_parts` in the picture, px."""
    row, column = np.divmod(faces, np.int32(shape[1]))
    across = (row[:, 1] - row[:, 0]) * (column[:, 2] - column[:, 0])
    across -= (column[:, 1] - column[:, 0]) * (row[:, 2] - row[:, 0])
    return np.asarray(0.5 * abs(across), np.float32)
