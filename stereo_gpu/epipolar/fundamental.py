"""The fundamental matrix from matched points of which some are wrong."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from stereo_gpu.epipolar.eight_point import FEWEST, with_unit_norm
from stereo_gpu.epipolar.plane import refuse_degenerate
from stereo_gpu.epipolar.points import check_points, normaliser, sampson_distances
from stereo_gpu.epipolar.robust import (
    CONFIDENCE,
    MOST_TRIALS,
    ROUNDING,
    START_PX,
    WIDEST_PX,
    WITHIN,
    Fit,
    best_of,
    fit_robustly,
)
from stereo_gpu.errors import StageError
from stereo_gpu.types import Doubles


class Fundamental(NamedTuple):
    """A fundamental matrix and what it rests on.

    Args:
        F: (3, 3), x_right' F x_left = 0, rank 2, Frobenius norm 1, entry of largest magnitude above zero.
        inliers: (N,) which matches fit it.
        noise_px: standard deviation of the Sampson distances of those.
    """

    F: Doubles
    inliers: NDArray[np.bool_]
    noise_px: float


def find_fundamental(points_left: ArrayLike, points_right: ArrayLike) -> Fundamental:
    """MAGSAC++ (Barath et al. 2020, in OpenCV), then the least Sampson distances over all matrices of rank 2.

    Those are U diag(cos a, sin a, 0) V' with rotations U and V (Bartoli and Sturm 2004), 7 parameters; the loss is
    Cauchy's, its scale the noise of the inliers.

    Args:
        points_left, points_right: (N, 2) px, N >= 8.

    Raises:
        InputError: the points are no such points, or lie on a line or in a plane.
        StageError: no F fits enough of them.
    """
    left, right = check_points(points_left, points_right, FEWEST)
    starts = _first_estimates(left, right)
    # Of wrong matches only those take part that one of the first estimates holds for right.
    near = [np.abs(sampson_distances(first, left, right)) < WIDEST_PX for first in starts]
    taken = np.any(near, axis=0) if near else np.zeros(len(left), bool)
    if int(taken.sum()) < FEWEST:
        raise StageError(
            f"no epipolar geometry fits {FEWEST} of {len(left)} matches: give pictures that show the same things"
        )
    F, fit = best_of([_refine(first, left[taken], right[taken]) for first in starts])
    extent = float(np.sqrt(left.var(axis=0).sum()))
    noise = max(fit.noise, ROUNDING * extent)
    inliers = np.abs(sampson_distances(F, left, right)) <= WITHIN * noise
    refuse_degenerate(left[inliers], right[inliers], F)
    return Fundamental(F, inliers, noise)


def _first_estimates(left: Doubles, right: Doubles) -> list[Doubles]:
    """Matrices by MAGSAC++ with several thresholds."""
    estimates = []
    for threshold in START_PX:
        try:
            F, _ = cv2.findFundamentalMat(left, right, cv2.USAC_MAGSAC, threshold, CONFIDENCE, MOST_TRIALS)
        except cv2.error:  # some versions fail on matches that no F fits
            continue
        if F is not None and F.shape == (3, 3) and np.isfinite(F).all():
            estimates.append(F)
    return estimates


def _refine(first: Doubles, left: Doubles, right: Doubles) -> tuple[Doubles, Fit]:
    """The F of least Sampson distances near `first`."""
    to_left, to_right = normaliser(left), normaliser(right)
    # The entries of F are of one order of magnitude only where both sides are normalised.
    U, values, Vt = np.linalg.svd(np.linalg.inv(to_right).T @ first @ np.linalg.inv(to_left))

    def compose(parameters: Doubles) -> Doubles:
        turn_left, turn_right = (cv2.Rodrigues(parameters[part])[0] for part in (slice(3, 6), slice(0, 3)))
        angle = parameters[6]
        middle = np.diag([np.cos(angle), np.sin(angle), 0.0])
        F: Doubles = to_right.T @ (U @ turn_right @ middle @ (Vt.T @ turn_left).T) @ to_left
        return F

    start = np.zeros(7)
    start[6] = np.arctan2(values[1], values[0])
    fit = fit_robustly(lambda trial: sampson_distances(compose(trial), left, right), start, START_PX[0])
    return with_unit_norm(compose(fit.parameters)), fit
