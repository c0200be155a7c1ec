"""Matched points of two pictures: checked, normalised, and how far they are from their epipolar lines."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from stereo_gpu.errors import InputError
from stereo_gpu.types import Doubles

FARTHEST = 1e8  # larger places are none of a picture
NEAREST = 1e-6  # px: points that are nearer to each other are one


def check_points(points_left: ArrayLike, points_right: ArrayLike, fewest: int) -> tuple[Doubles, Doubles]:
    """Both sides as (N, 2) float64.

    Args:
        points_left, points_right: (N, 2), the same N.
        fewest: N must reach it, and so must the number of matches that differ from each other.

    Raises:
        InputError: wrong shapes, values that are not finite or far too large, one place, or too few matches.
    """
    sides = []
    for name, points in (("points_left", points_left), ("points_right", points_right)):
        try:
            array = np.asarray(points)
        except ValueError:  # rows of unequal length
            raise InputError(f"{name} is {points!r:.60}: give an array of shape (N, 2)") from None
        if array.ndim != 2 or array.shape[1] != 2 or array.dtype.kind not in "fiu":
            raise InputError(f"{name} has shape {array.shape} of {array.dtype}: give numbers of shape (N, 2), in px")
        array = array.astype(np.float64)
        bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
        if len(bad):
            raise InputError(f"{name}[{bad[0]}] is {array[bad[0]].tolist()}: leave such matches out on both sides")
        if len(array) and np.abs(array).max() > FARTHEST:
            raise InputError(f"{name} reaches {np.abs(array).max():.2g}, the limit is {FARTHEST:g}: give places in px")
        if len(array) > 1 and np.ptp(array, axis=0).max() < NEAREST:
            raise InputError(f"{name} holds {len(array)} points at one place: give points all over the picture")
        sides.append(array)
    left, right = sides
    if len(left) != len(right):
        raise InputError(f"{len(left)} points on the left, {len(right)} on the right: give them in pairs")
    if len(left) < fewest:
        raise InputError(f"{len(left)} matched points, {fewest} are needed: add matches")
    distinct = len(np.unique(np.hstack([left, right]), axis=0))
    if distinct < fewest:
        raise InputError(
            f"{distinct} of {len(left)} matches differ from each other, {fewest} are needed: add other matches"
        )
    return left, right


def homogeneous(points: Doubles) -> Doubles:
    """(N, 3): x, y and 1."""
    return np.column_stack([points, np.ones(len(points))])


def normaliser(points: Doubles) -> Doubles:
    """(3, 3): moves the centroid to 0 and the mean distance from it to the root of 2 (Hartley 1997, section 5.1)."""
    centre = points.mean(axis=0)
    scale = np.sqrt(2) / np.linalg.norm(points - centre, axis=1).mean()
    return np.array([[scale, 0, -scale * centre[0]], [0, scale, -scale * centre[1]], [0, 0, 1]])


def cross_matrix(vector: Doubles) -> Doubles:
    """(3, 3): its product with x is the cross product of `vector` and x."""
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def sampson_distances(F: Doubles, points_left: Doubles, points_right: Doubles) -> Doubles:
    """(N,) signed: how far both points together must move to fit, to first order (Sampson 1982).

    Args:
        F: (3, 3), x_right' F x_left = 0.
        points_left, points_right: (N, 2); the distances are in their unit.
    """
    algebraic, at_right, at_left = _lines(F, points_left, points_right)
    slope = np.hypot(np.linalg.norm(at_right[:, :2], axis=1), np.linalg.norm(at_left[:, :2], axis=1))
    distances: Doubles = algebraic / np.maximum(slope, np.finfo(np.float64).tiny)
    return distances


def symmetric_distances(F: Doubles, points_left: Doubles, points_right: Doubles) -> Doubles:
    """(N,) root mean square, over both pictures, of the distance between a point and its partner's epipolar line.

    Args:
        F: (3, 3), x_right' F x_left = 0.
        points_left, points_right: (N, 2); the distances are in their unit.
    """
    algebraic, at_right, at_left = _lines(F, points_left, points_right)
    tiny = np.finfo(np.float64).tiny
    squares = [(algebraic / np.maximum(np.linalg.norm(line[:, :2], axis=1), tiny)) ** 2 for line in (at_right, at_left)]
    distances: Doubles = np.sqrt(np.mean(squares, axis=0))
    return distances


def _lines(F: Doubles, points_left: Doubles, points_right: Doubles) -> tuple[Doubles, Doubles, Doubles]:
    """x_right' F x_left, (N,), and the epipolar lines in the right and in the left picture, (N, 3)."""
    left, right = homogeneous(points_left), homogeneous(points_right)
    at_right, at_left = left @ F.T, right @ F
    return (right * at_right).sum(axis=1), at_right, at_left
