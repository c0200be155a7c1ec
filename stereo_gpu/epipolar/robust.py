"""Fit parameters to residuals of which some are wrong: how large noise is comes out of the residuals themselves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from stereo_gpu.types import Doubles

ROUNDS = 4  # noise and parameters in turn; the third changes little
WITHIN = 3.0  # times the noise: an inlier
MAD_TO_SIGMA = 1.4826  # of a normal distribution
START_PX = (0.5, 1.0, 2.0)  # how far inliers of MAGSAC's estimates may be from their epipolar lines
WIDEST_PX = 5.0  # what is farther from the lines of all those estimates is wrong
CONFIDENCE, MOST_TRIALS = 0.9999, 10_000  # of MAGSAC
ROUNDING = 1e-7  # of the points' extent, or of the focal length: what exact points misfit by
SMALLEST_NOISE = 1e-9  # so that exact points do not divide by zero

Model = TypeVar("Model")


@dataclass(frozen=True, kw_only=True)
class Fit:
    """What was fitted.

    Args:
        parameters: (P,).
        deviations: (P,) standard deviations of the parameters, from the noise and the slopes.
        residuals: (N,) with these parameters.
        noise: standard deviation of the residuals that are noise, in their unit.
        surprise: sum of squares of how far the parameters are from what was expected, in its deviations.
    """

    parameters: Doubles
    deviations: Doubles
    residuals: Doubles
    noise: float
    surprise: float = 0.0


def fit_robustly(
    residuals: Callable[[Doubles], Doubles],
    start: Doubles,
    noise: float,
    expected: tuple[Doubles, Doubles] | None = None,
) -> Fit:
    """Least squares with Cauchy's loss, whose scale is the noise found in the round before.

    Noise is told by the median of all residuals: of those that fit alone it would shrink from round to round,
    until a few points count.

    Args:
        residuals: parameters (P,) to residuals (N,), the same N each time, most of them noise.
        start: (P,).
        noise: standard deviation of the residuals, a first guess.
        expected: (P,) what the parameters are likely to be, and (P,) by which standard deviation.
    """
    from scipy.optimize import least_squares

    def surprises(trial: Doubles) -> Doubles:
        return np.zeros(0) if expected is None else (trial - expected[0]) / expected[1]

    parameters, off = start, residuals(start)
    for _ in range(ROUNDS):

        def weighed(trial: Doubles, scale: float = noise) -> Doubles:
            # Cauchy's loss by hand, since what is known beforehand is not to be taken for an outlier.
            off = residuals(trial) / scale
            eased = np.copysign(np.sqrt(np.log1p(off * off)), off)  # smooth at zero
            known: Doubles = np.concatenate([eased, surprises(trial)])
            return known

        found = least_squares(weighed, parameters, x_scale="jac")
        parameters, off = found.x, residuals(found.x)
        noise = max(SMALLEST_NOISE, MAD_TO_SIGMA * float(np.median(np.abs(off))))
    covariance = np.linalg.pinv(found.jac.T @ found.jac)
    deviations = np.sqrt(np.maximum(0, np.diag(covariance)))
    surprise = float((surprises(parameters) ** 2).sum())
    return Fit(parameters=parameters, deviations=deviations, residuals=off, noise=noise, surprise=surprise)


def best_of(fits: Sequence[tuple[Model, Fit]]) -> tuple[Model, Fit]:
    """The model that fits most of the same points well, where the smallest noise of all is taken for all."""
    noise = min(fit.noise for _, fit in fits)
    return min(fits, key=lambda each: misfit(each[1], noise))


def misfit(fit: Fit, noise: float) -> float:
    """About how many points do not fit, where residuals as large as `noise` count half; surprises count too.

    The loss is that of Geman and McClure (1987), which ends at 1: a wrong match must not tell how wrong it is. With
    Cauchy's, matches of OpenCV's plain SIFT chose a pose 3 degrees off that was less than a pixel wrong all over.
    """
    squares = (fit.residuals / noise) ** 2
    return float((squares / (1 + squares)).sum()) + fit.surprise
