"""What several formats write a rig's geometry with: rounded rotations, and projections of rectified cameras."""

from __future__ import annotations

import logging

import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.rig import ROTATION_TOLERANCE
from stereo_gpu.rig_files.tree import LARGEST_NUMBER
from stereo_gpu.types import Doubles

ROUNDED = 1e-3  # largest |R R' - 1| of a rotation that was rounded; a worse one is none

logger = logging.getLogger(__name__)


def mend_rotation(name: str, matrix: Doubles) -> Doubles:
    """`matrix`, (3, 3), to the bit where it is a rotation, and the rotation nearest to it where it was rounded.

    Raises:
        InputError: it is no rotation, or mirrors.
    """
    off = float(np.abs(matrix @ matrix.T - np.eye(3)).max()) if np.abs(matrix).max() < 10 else np.inf
    if off > ROUNDED or np.linalg.det(matrix) < 0:
        raise InputError(
            f"{name} is no rotation: it {'mirrors' if off <= ROUNDED else f'is off by {off:.2g}'}; mend the value"
        )
    if off <= ROTATION_TOLERANCE:
        return matrix
    logger.warning("%s is rounded (off by %.1g): the nearest rotation is used", name, off)
    u, _, v = np.linalg.svd(matrix)
    nearest: Doubles = u @ v
    return nearest


def shift(name: str, projection: Doubles) -> Doubles:
    """(3,) translation t of a rectified camera whose (3, 4) projection is K [1 | t].

    Raises:
        InputError: K cannot be inverted.
    """
    matrix = projection[:, :3]
    # Not the determinant, which over- and underflows: the matrix is upper triangular where it is a camera's.
    if not (np.diag(matrix) > 0).all() or np.tril(matrix, -1).any():
        raise InputError(f"{name} must read fx s cx . / 0 fy cy . / 0 0 1 ., but has {matrix.tolist()!s:.60}")
    with np.errstate(over="ignore", invalid="ignore"):
        found = np.linalg.solve(matrix, projection[:, 3]).astype(np.float64)
    if not (np.abs(found) <= LARGEST_NUMBER).all():
        raise InputError(f"{name} gives a shift of {np.abs(found).max():g}: mend the value")
    return found
