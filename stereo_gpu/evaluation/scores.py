"""Hold a disparity map against its truth: bad pixels, errors and coverage, as Middlebury's benchmark counts them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.errors import InputError
from stereo_gpu.types import Floats

THRESHOLDS = (0.5, 1.0, 2.0, 4.0)  # px
QUANTILES = (50, 90, 95)  # per cent

# px by which an error may exceed a threshold and still equal it: what float32 loses of two disparities up to 512 px
# whose scale is not a power of two, such as the thirds of Middlebury's small pictures.
ROUNDING = 2.0**-14

Mask = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class Scores:
    """What a map is worth over the counted pixels; lengths in px, shares in 0..1.

    Args:
        counted: how many pixels are counted: those of the mask whose truth is known.
        given: how many of these have a value.
        bad: threshold -> share of the counted pixels that are wrong by more than it or have no value.
        bad_given: threshold -> share of the given values that are wrong by more than it; NaN if none is given.
        mean, rms: mean and root mean square of the given values' absolute errors; NaN if none is given.
        quantiles: per cent -> the absolute error that so many of the given values do not exceed, interpolated
            linearly; NaN if none is given. Middlebury's A50, A90 and A95.
    """

    counted: int
    given: int
    bad: dict[float, float]
    bad_given: dict[float, float]
    mean: float
    rms: float
    quantiles: dict[int, float]

    @property
    def coverage(self) -> float:
        """Share of the counted pixels that have a value, also called density."""
        return self.given / self.counted

    def as_dict(self) -> dict[str, Any]:
        """The scores under flat names that JSON takes: bad_1.0, bad_1.0_given, a50 and so on; None for NaN."""
        flat = {"counted": self.counted, "given": self.given, "coverage": self.coverage}
        flat |= {f"bad_{threshold}": share for threshold, share in self.bad.items()}
        flat |= {f"bad_{threshold}_given": share for threshold, share in self.bad_given.items()}
        flat |= {"mean": self.mean, "rms": self.rms}
        flat |= {f"a{share}": error for share, error in self.quantiles.items()}
        return {name: None if np.isnan(number) else number for name, number in flat.items()}


def score(values: Floats, truth: Floats, counted: Mask | None = None) -> Scores:
    """Score a disparity map over the counted pixels whose truth is known.

    Args:
        values: (H, W) px, not finite where there is none.
        truth: (H, W) px, not finite where it is unknown.
        counted: (H, W) bool, the pixels to count; None counts all.

    Raises:
        InputError: shapes differ, the mask is not of bool, or no pixel is left to count.

    Source: Scharstein and Szeliski, "A Taxonomy and Evaluation of Dense Two-Frame Stereo", section 5.1, and
        Middlebury's stereo evaluation, versions 2 and 3. A pixel is bad if its error exceeds the threshold; one that
        equals it is good.
    """
    mask = countable(values, truth, counted)
    found, true = values[mask].astype(np.float64), truth[mask].astype(np.float64)
    given = np.isfinite(found)
    errors = np.abs(found[given] - true[given])
    wrong = {threshold: int((errors > threshold + ROUNDING).sum()) for threshold in THRESHOLDS}
    missing = found.size - errors.size
    some = errors.size > 0
    return Scores(
        counted=found.size,
        given=errors.size,
        bad={threshold: (count + missing) / found.size for threshold, count in wrong.items()},
        bad_given={threshold: count / errors.size if some else np.nan for threshold, count in wrong.items()},
        mean=float(errors.mean()) if some else np.nan,
        rms=float(np.sqrt(np.square(errors).mean())) if some else np.nan,
        quantiles={share: float(np.percentile(errors, share)) if some else np.nan for share in QUANTILES},
    )


def countable(values: Floats, truth: Floats, counted: Mask | None = None) -> Mask:
    """The pixels that a score counts, (H, W) bool: those of the mask whose truth is known.

    Raises:
        InputError: shapes differ, the mask is not of bool, or no pixel is left.
    """
    if values.ndim != 2 or values.shape != truth.shape:
        raise InputError(f"the map is {size(values)}, its truth {size(truth)}: give two of one size")
    known = np.isfinite(truth)
    if counted is not None:
        if counted.dtype != np.bool_:
            raise InputError(f"the mask of counted pixels holds {counted.dtype}: say which count, as in mask == 255")
        if counted.shape != truth.shape:
            raise InputError(f"the mask is {size(counted)}, the truth {size(truth)}: give two of one size")
        known &= counted
    if not known.any():
        raise InputError(f"none of {known.size} pixels is counted and has a truth: give another mask or truth")
    return known


def size(array: NDArray[Any]) -> str:
    """Width x height of a map in words, or its shape if it is none."""
    return f"{array.shape[1]} x {array.shape[0]} px" if array.ndim == 2 else f"of shape {array.shape}"
