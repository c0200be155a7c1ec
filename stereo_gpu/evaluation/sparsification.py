"""Does confidence tell good values from bad ones: what is left of the errors when the least confident values go first.

Source: Hu and Mordohai, "A Quantitative Evaluation of Confidence Measures for Stereo Vision", TPAMI 2012, section 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.errors import InputError
from stereo_gpu.evaluation.scores import ROUNDING, Mask, countable, size
from stereo_gpu.types import Doubles, Floats

POINTS = 100  # of a curve that is kept


@dataclass(frozen=True, kw_only=True)
class Curve:
    """How an error falls as the least confident of the given values are taken away; of bad pixels, or in px.

    Args:
        density: (100,) share of the given values that is kept, from 0.01 to 1.
        rest: (100,) error of the values that are kept.
        oracle: (100,) the same where the largest errors go first: no confidence can do better.
        area: area under `rest`, over all densities from 0 to 1: the mean error of what is kept.
        oracle_area: area under `oracle`.
        random_area: area where values go at random: the error of all of them.
    """

    density: Doubles
    rest: Doubles
    oracle: Doubles
    area: float
    oracle_area: float
    random_area: float

    @property
    def ause(self) -> float:
        """Area between the curve and the oracle's; 0 is perfect."""
        return self.area - self.oracle_area

    @property
    def share_of_random(self) -> float:
        """`ause` as a share of what no confidence at all leaves: 0 is perfect, 1 tells nothing; NaN without errors."""
        span = self.random_area - self.oracle_area
        return self.ause / span if span > 0 else float("nan")

    def as_dict(self) -> dict[str, Any]:
        """The areas and the curves, as JSON takes them."""
        share = self.share_of_random
        return {
            "area": self.area,
            "oracle_area": self.oracle_area,
            "random_area": self.random_area,
            "ause": self.ause,
            "share_of_random": None if np.isnan(share) else share,
            "density": self.density.tolist(),
            "rest": self.rest.tolist(),
            "oracle": self.oracle.tolist(),
        }


@dataclass(frozen=True, kw_only=True)
class Sparsification:
    """The curves of bad pixels and of the mean absolute error, px."""

    bad: Curve
    mean: Curve


def sparsify(
    values: Floats, truth: Floats, confidence: Floats, counted: Mask | None = None, *, threshold: float = 1.0
) -> Sparsification:
    """Take away the given values from the least confident to the most, and follow the errors of the rest.

    Values of one confidence go together: between them the curve is what it is on average if they go in any order, so
    that a constant confidence scores as random.

    Args:
        values: (H, W) px, not finite where there is none; these pixels take no part.
        truth: (H, W) px, not finite where it is unknown.
        confidence: (H, W), more is surer; not finite counts as least.
        counted: (H, W) bool, the pixels to count; None counts all.
        threshold: error over which a value is bad, px.

    Raises:
        InputError: sizes differ, or no counted pixel with a truth has a value.
    """
    if confidence.shape != values.shape:
        raise InputError(f"the confidence is {size(confidence)}, the map {size(values)}: give two of one size")
    mask = countable(values, truth, counted) & np.isfinite(values)
    if not mask.any():
        raise InputError(f"the map gives none of {values.size} pixels a value that counts: nothing to be sure of")
    errors = np.abs(values[mask].astype(np.float64) - truth[mask])
    sureness = np.where(np.isfinite(confidence), confidence, -np.inf)[mask]
    wrong = (errors > threshold + ROUNDING).astype(np.float64)
    return Sparsification(bad=_curve(wrong, sureness), mean=_curve(errors, sureness))


def _curve(errors: Doubles, sureness: NDArray[Any]) -> Curve:
    kept, best = _errors_of_rest(errors, sureness), _errors_of_rest(errors, -errors)
    density = np.arange(1, POINTS + 1) / POINTS
    at = np.maximum(np.round(density * errors.size).astype(np.int64), 1) - 1
    return Curve(
        density=density,
        rest=kept[at],
        oracle=best[at],
        area=float(kept.mean()),
        oracle_area=float(best.mean()),
        random_area=float(errors.mean()),
    )


def _errors_of_rest(errors: Doubles, sureness: NDArray[Any]) -> Doubles:
    """Mean error of the 1, 2, ... surest values."""
    _, group, count = np.unique(-sureness, return_inverse=True, return_counts=True)
    mean_of_group = np.bincount(group, errors) / count
    return np.asarray(np.cumsum(np.repeat(mean_of_group, count)) / np.arange(1, errors.size + 1))
