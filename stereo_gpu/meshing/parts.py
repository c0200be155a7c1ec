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


def covered_pixels(faces: Ints, shape: tuple[int, ...]) -> Floats:
    """(M,): area of each face of `number_parts` in the picture, px."""
    row, column = np.divmod(faces, np.int32(shape[1]))
    across = (row[:, 1] - row[:, 0]) * (column[:, 2] - column[:, 0])
    across -= (column[:, 1] - column[:, 0]) * (row[:, 2] - row[:, 0])
    return np.asarray(0.5 * abs(across), np.float32)
