"""How many lens coefficients: the fewest that predict views left out as well as any number does.

More coefficients always fit better, and soon fit the noise. So each model is fitted to four fifths of the views and
judged by the rest, in turn (k-fold cross-validation; Hastie, Tibshirani and Friedman, "The Elements of Statistical
Learning", 2009, section 7.10, with its rule of one standard error). A model that makes the rig much less certain is
not taken, however well it fits: the thin prism of 12 coefficients looks nearly like a turn of the camera.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stereo_gpu.calibration.bundle import Bundle, Corners, linearise, refine
from stereo_gpu.calibration.fit import Fit, both_distances
from stereo_gpu.calibration.uncertainty import find_deviations, shared_covariance
from stereo_gpu.rig import DISTORTION_COUNTS
from stereo_gpu.types import Doubles

FOLDS = 5
SETTLED = 1e-5  # of the squares: far below what tells models apart
LESS_CERTAIN = 2.0  # times, in om or T: such a model is not taken


@dataclass(frozen=True, kw_only=True)
class LensModels:
    """What the models' errors on views left out tell.

    Args:
        chosen: 5, 8 or 12.
        errors_px: of each model, mean rms error of the views left out.
        refused: why a model was not taken, where it would have been by its error.
    """

    chosen: int
    errors_px: dict[int, float]
    refused: dict[int, str]


def choose_lens_model(simplest: Fit) -> LensModels:
    """Choose among 5, 8 and 12 coefficients.

    Args:
        simplest: the fit with 5.
    """
    fits = {
        count: refine(_with(simplest.bundle, count), simplest.corners, settled=SETTLED) for count in DISTORTION_COUNTS
    }
    errors = {count: _error_left_out(fit, simplest.corners) for count, fit in fits.items()}
    means = {count: float(off.mean()) for count, off in errors.items()}
    refused: dict[int, str] = {}
    certain = _deviations(simplest.bundle, simplest)
    allowed = list(DISTORTION_COUNTS)
    while True:
        best = min(allowed, key=means.__getitem__)
        # The same views judge all models, so that it is the difference view by view whose standard error counts.
        chosen = next(count for count in allowed if means[count] - means[best] <= _standard_error(errors, count, best))
        if chosen == DISTORTION_COUNTS[0]:
            break
        ratio = float((_deviations(fits[chosen], simplest) / certain).max())
        if ratio <= LESS_CERTAIN:
            break
        refused[chosen] = f"R or T would be {ratio:.1f} times less certain"
        allowed.remove(chosen)
    return LensModels(chosen=chosen, errors_px=means, refused=refused)


def _with(bundle: Bundle, coefficients: int) -> Bundle:
    """The same cameras, with more coefficients that start at zero."""
    left, right = (np.concatenate([lens, np.zeros(4 + coefficients - len(lens))]) for lens in bundle.lenses)
    return replace(bundle, lenses=(left, right))


def _error_left_out(start: Bundle, corners: tuple[Corners, Corners]) -> Doubles:
    """(views,) rms px of each view, when the lenses come from others; its own pose is fitted.

    Args:
        start: fitted to all views.
        corners: of all views.
    """
    views = len(start.rotations)
    errors = np.empty(views)
    for fold in range(min(FOLDS, views)):
        out = list(range(fold, views, FOLDS))
        kept = [view for view in range(views) if view not in out]
        learned = refine(start.only(kept), _only(corners, kept), settled=SETTLED)
        judged = replace(learned, rotations=start.rotations[out], translations=start.translations[out])
        ours = _only(corners, out)
        judged = refine(judged, ours, poses_only=True, settled=SETTLED)
        errors[out] = [np.sqrt((off**2).mean()) for off in both_distances(judged, ours)]
    return errors


def _only(corners: tuple[Corners, Corners], views: list[int]) -> tuple[Corners, Corners]:
    return corners[0].only(views), corners[1].only(views)


def _standard_error(errors: dict[int, Doubles], one: int, other: int) -> float:
    difference = errors[one] - errors[other]
    return float(difference.std(ddof=1) / np.sqrt(len(difference)))


def _deviations(bundle: Bundle, fit: Fit) -> Doubles:
    """(6,) of om and T."""
    found = find_deviations(bundle, shared_covariance(linearise(bundle, fit.corners), fit.count))
    return np.concatenate([found.om, found.T])
