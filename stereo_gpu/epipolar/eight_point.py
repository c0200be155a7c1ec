"""The fundamental matrix from eight or more matched points, all of them right."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from stereo_gpu.epipolar.plane import refuse_degenerate
from stereo_gpu.epipolar.points import check_points, homogeneous, normaliser
from stereo_gpu.types import Doubles

FEWEST = 8


def eight_point(points_left: ArrayLike, points_right: ArrayLike) -> Doubles:
    """The normalised eight-point algorithm: Hartley, In Defense of the Eight-Point Algorithm, PAMI 1997.

    x_right' F x_left = 0 for every match, equation 5 of the paper. Both sides are moved to their centroid and scaled,
    the smallest singular vector of the (N, 9) system is F, and the nearest matrix of rank 2 is taken. Every match
    counts, so a wrong one spoils F: `find_fundamental` leaves those out.

    Args:
        points_left, points_right: (N, 2) px, N >= 8.

    Returns:
        F, (3, 3) float64 of rank 2 and Frobenius norm 1; its entry of largest magnitude is above zero.

    Raises:
        InputError: fewer than 8 different matches, values that are not finite, or points on a line or in a plane.
    """
    left, right = check_points(points_left, points_right, FEWEST)
    F = fit_fundamental(left, right)
    refuse_degenerate(left, right, F)
    return F


def fit_fundamental(points_left: Doubles, points_right: Doubles) -> Doubles:
    """F as in `eight_point`, of points that are known to be good."""
    to_left, to_right = normaliser(points_left), normaliser(points_right)
    left, right = homogeneous(points_left) @ to_left.T, homogeneous(points_right) @ to_right.T
    system = (right[:, :, None] * left[:, None, :]).reshape(-1, 9)
    if len(system) < 9:  # a row of zeros, so that the decomposition has all nine vectors without a (N, N) matrix
        system = np.vstack([system, np.zeros((9 - len(system), 9))])
    F = np.linalg.svd(system, full_matrices=False)[2][-1].reshape(3, 3)
    return with_unit_norm(to_right.T @ nearest_of_rank_2(F) @ to_left)


def nearest_of_rank_2(matrix: Doubles) -> Doubles:
    """`matrix` with its smallest singular value set to 0."""
    left, values, right = np.linalg.svd(matrix)
    nearest: Doubles = (left * np.array([values[0], values[1], 0.0])) @ right
    return nearest


def with_unit_norm(F: Doubles) -> Doubles:
    """`F` scaled to Frobenius norm 1, the entry of largest magnitude above zero."""
    largest = F.reshape(-1)[np.abs(F).argmax()]
    scaled: Doubles = F / (np.linalg.norm(F) * np.sign(largest))
    return scaled
