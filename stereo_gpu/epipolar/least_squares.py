"""Robust least squares of a few numbers; SciPy's own takes a fifth of a second to import, the fit some milliseconds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stereo_gpu.types import Doubles

ROUNDS = 50  # of slopes, at most; ten are usual
STEP = 1.5e-8  # of the slopes' differences: the square root of a double's rounding
SMALL = 1e-8  # change of the sum, or of all numbers, that ends the search
NEAR = 0.01  # change of the sum from which on it looks quadratic
FIRST_DAMPING, MOST_DAMPING = 1e-6, 1e12


@dataclass(frozen=True, kw_only=True)
class Soft:
    """What was fitted.

    Args:
        numbers: (P,).
        slopes: (N, P) of the residuals, weighed so that slopes.T @ slopes is the curvature of the sum.
    """

    numbers: Doubles
    slopes: Doubles


def fit_softly(
    residuals: Callable[[Doubles], Doubles],
    start: Doubles,
    scale: Doubles,
    *,
    largest: float = np.inf,
) -> Soft:
    """The numbers with the smallest sum of 2 (sqrt(1 + r^2) - 1), by Levenberg's and Marquardt's method.

    The loss counts residuals far over 1 by their size, not their square; second order as in Triggs et al., "Bundle
    Adjustment: a Modern Synthesis" (2000).

    Args:
        residuals: numbers (P,) to residuals (N,), in units of their noise.
        start: (P,).
        scale: (P,) how large changes of the numbers usually are.
        largest: number that is allowed, either way.
    """
    numbers, off = np.asarray(start, np.float64), residuals(start)
    damping, total, near = FIRST_DAMPING, _sum(off), False
    slopes = _slopes(residuals, numbers, off)
    for _ in range(ROUNDS):
        # The loss's own curvature overshoots far from the end, where that of reweighted squares lies above the loss.
        weights = _curvature(off) if near else (1 + off * off) ** -0.25
        weighed = slopes * weights[:, None] * scale
        uphill = (slopes * scale).T @ (off / np.sqrt(1 + off * off))
        square = weighed.T @ weighed
        while True:
            damped = square + damping * np.diag(np.maximum(np.diag(square), 1e-300))
            step = -np.linalg.lstsq(damped, uphill, rcond=None)[0]
            trial = np.clip(numbers + scale * step, -largest, largest)
            found = residuals(trial)
            lower = _sum(found)
            if lower <= total or damping > MOST_DAMPING:
                break
            damping *= 10
        if not lower <= total:
            break
        near = total - lower <= NEAR * total
        done = total - lower <= SMALL * total or bool((np.abs(step) <= SMALL).all())
        numbers, off, total = trial, found, lower
        slopes = _slopes(residuals, numbers, off)
        damping = max(damping / 10, FIRST_DAMPING)
        if done:
            break
    return Soft(numbers=numbers, slopes=slopes * _curvature(off)[:, None])


def _sum(residuals: Doubles) -> float:
    # As 2 r^2 / (1 + sqrt(1 + r^2)), which loses no digits where r is small.
    squares = residuals * residuals
    return float((2 * squares / (1 + np.sqrt(1 + squares))).sum())


def _curvature(residuals: Doubles) -> Doubles:
    """The root of the loss's second derivative, halved as that of r^2."""
    curvature: Doubles = (1 + residuals * residuals) ** -0.75
    return curvature


def _slopes(residuals: Callable[[Doubles], Doubles], numbers: Doubles, off: Doubles) -> Doubles:
    columns = []
    for place, number in enumerate(numbers):
        moved = numbers.copy()
        moved[place] += STEP * max(1.0, abs(number))
        columns.append((residuals(moved) - off) / (moved[place] - number))
    return np.column_stack(columns)
