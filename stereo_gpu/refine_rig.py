"""Correct a rig by the small drift that a raw pair shows, and say by how much."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.deviations import Deviations
from stereo_gpu.epipolar.drift import ALL, DOWN, PITCH, ROLL, YAW, Drift, drifted, fit_drift
from stereo_gpu.epipolar.error_map import CELLS, cells_of
from stereo_gpu.epipolar.faults import Fault
from stereo_gpu.epipolar.rows import find_rows, focal_length, rays
from stereo_gpu.errors import InputError
from stereo_gpu.rig import Rig
from stereo_gpu.rig_check import RigCheck, Verdict, check_rig
from stereo_gpu.types import Doubles, Ints, Picture

FEWEST = 40  # features that agree
SPREAD = 0.2  # of the picture's width and height, which the middle nine tenths of the features must span
FOLDS = 5
SURE = 2.0  # standard deviations by which a correction must help the features held out
# What may be corrected, in steps; a step is taken only if it lowers the error on features held out to this share.
# Pitch and roll move rows all over the frame. Yaw and the camera's place barely do, so that a lens model that is off
# by a twentieth of a pixel can pass for them, and yaw makes all depths wrong.
STEPS: tuple[tuple[int, ...], ...] = ((PITCH, ROLL), (PITCH, YAW, ROLL), ALL)
WORTH_A_STEP = 0.8
NAMES = ("pitch", "yaw", "roll", "down", "forward")
CELL_WEIGHT = 4.0  # features: a cell of the frame with more of them counts as these


@dataclass(frozen=True, kw_only=True, eq=False)
class Refinement:
    """A rig corrected from a pair.

    Args:
        rig: the new rig, or the given one where nothing was to be corrected.
        changed: whether it is a new one.
        drift: how the right camera turned and moved; zero where the rig is the given one.
        before_px, after_px: median vertical error before, and after on features that had no part in the correction.
        features: how many there were.
        says: the same in words.
    """

    rig: Rig
    changed: bool
    drift: Drift
    before_px: float
    after_px: float
    features: int
    says: str

    def record(self) -> dict[str, Any]:
        """All numbers, for JSON; angles in degrees."""
        return {
            "changed": self.changed,
            "says": self.says,
            "turn_deg": self.drift.turn.tolist(),
            "move_deg": self.drift.move.tolist(),
            "deviations_deg": self.drift.deviations.tolist(),
            "before_px": self.before_px,
            "after_px": self.after_px,
            "features": self.features,
        }


def refine_rig(left: Picture, right: Picture, rig: Rig, *, checked: RigCheck | None = None) -> Refinement:
    """Correct the pose of a rig's right camera so that matched features of a raw pair lie on common rows.

    Rotation and the direction of T are corrected, five numbers, all that rows can tell; the length of T, the lenses
    and what the pair says nothing of stay as calibrated. Features of a fifth of the frame's cells at a time are held
    out, and the rig stays as it was unless their rows come closer.

    Args:
        left, right: raw pictures of the rig's cameras.
        rig: as it was calibrated.
        checked: what `check_rig` said of the same three; None asks it.

    Raises:
        InputError: the pictures do not fit, the features are too few or too close together, or what is wrong is no
            small drift.
    """
    checked = checked or check_rig(left, right, rig)
    _refuse(checked)
    focal = focal_length(rig)
    sides = rays(checked.points_left, rig.left), rays(checked.points_right, rig.right)
    cells = cells_of(checked.points_left, checked.size)
    weights = _weights(cells)
    before = float(np.median(np.abs(checked.vertical)))
    free, (errors, spread) = STEPS[0], _held_out(sides, rig, focal, cells, weights, STEPS[0])
    for step in STEPS[1:]:
        tried = _held_out(sides, rig, focal, cells, weights, step)
        if _mean(tried[0]) <= WORTH_A_STEP * _mean(errors):
            free, (errors, spread) = step, tried
    after = float(np.median(np.abs(errors)))
    drift, _ = fit_drift(*sides, rig, focal, weights=weights, free=free)
    drift = dataclasses.replace(drift, deviations=np.maximum(drift.deviations, spread))
    if after > before or _gain(checked.vertical, errors, cells, weights) < SURE:
        nothing = Drift(turn=np.zeros(3), move=np.zeros(2), deviations=drift.deviations)
        return Refinement(
            rig=rig,
            changed=False,
            drift=nothing,
            before_px=before,
            after_px=before,
            features=len(weights),
            says=f"nothing to correct: rows differ by {before:.2f} px (median of {len(weights)} features), and by"
            f" {after:.2f} px on features held out from a correction",
        )
    return Refinement(
        rig=dataclasses.replace(drifted(rig, drift), deviations=_deviations(rig, drift)),
        changed=True,
        drift=drift,
        before_px=before,
        after_px=after,
        features=len(weights),
        says=_in_words(drift, free, before, after, len(weights)),
    )


def _refuse(checked: RigCheck) -> None:
    """Refuse pairs from which no small drift can be told."""
    if checked.verdict is Verdict.UNKNOWN:
        raise InputError(f"the rig cannot be refined: {checked.says}")
    wrong = checked.fault in (Fault.SWAPPED, Fault.OTHER_RIG, Fault.SCATTERED)
    if wrong or (checked.fault is Fault.SCALED and checked.verdict is not Verdict.GOOD):
        raise InputError(f"the rig cannot be refined, no small turn of a camera explains it: {checked.says}")
    used = len(checked.vertical)
    if used < FEWEST:
        raise InputError(
            f"the rig cannot be refined from {used} matched features, {FEWEST} are needed: take a pair with more"
            " texture that both cameras see"
        )
    low, high = np.percentile(checked.points_left, [5, 95], axis=0)
    spans = (high - low) / checked.size
    if spans.min() < SPREAD:
        raise InputError(
            f"the rig cannot be refined: the matched features span {spans[0]:.0%} of the picture's width and"
            f" {spans[1]:.0%} of its height, {SPREAD:.0%} of both are needed; take a pair with texture all over it"
        )


def _weights(cells: Ints) -> Doubles:
    """(N,) weights by which crowded cells do not decide alone."""
    counts = np.bincount(cells, minlength=CELLS[0] * CELLS[1])[cells]
    weights: Doubles = np.sqrt(np.minimum(1.0, CELL_WEIGHT / counts))
    return weights


def _held_out(
    sides: tuple[Doubles, Doubles], rig: Rig, focal: float, cells: Ints, weights: Doubles, free: tuple[int, ...]
) -> tuple[Doubles, Doubles]:
    """Errors of all features after corrections in which they had no part, (N,) px, and how far those differ.

    The second, (5,) degrees, is the jackknife's deviation of turn and move: neighbours err alike, so that the
    residuals of the single features would promise too much.
    """
    errors, fits = np.empty(len(cells)), []
    folds = _folds(cells)
    for fold in np.unique(folds):
        out = folds == fold
        drift, _ = fit_drift(sides[0][~out], sides[1][~out], rig, focal, weights=weights[~out], free=free)
        fits.append(np.concatenate([drift.turn, drift.move]))
        corrected = drifted(rig, drift)
        errors[out] = find_rows(sides[0][out], sides[1][out], corrected.R, corrected.T, focal).vertical
    spread: Doubles = np.std(fits, axis=0) * np.sqrt(len(fits) - 1)
    return errors, spread


def _mean(errors: Doubles) -> float:
    """Mean error, a wrong match counting as 1 px; it tells two fits to the same features apart better than medians."""
    return float(np.minimum(np.abs(errors), 1.0).mean())


def _gain(before: Doubles, after: Doubles, cells: Ints, weights: Doubles) -> float:
    """By how many of its own standard deviations the mean error fell, each cell counting as one witness."""
    most = max(1.0, 3 * float(np.median(np.abs(before))))
    fell = np.bincount(cells, weights**2 * (np.minimum(np.abs(before), most) - np.fmin(np.abs(after), most)))
    spread = float(np.linalg.norm(fell))
    return float(fell.sum()) / spread if spread > 0 else 0.0


def _folds(cells: Ints) -> NDArray[np.intp]:
    """(N,) fold of each feature: whole cells together, since neighbours err alike, and in turn over the frame."""
    _, order = np.unique(cells, return_inverse=True)
    folds: NDArray[np.intp] = order % FOLDS
    return folds


def _deviations(rig: Rig, drift: Drift) -> Deviations | None:
    """The rig's deviations, widened by those of the correction."""
    if rig.deviations is None:
        return None
    turn, move = np.radians(drift.deviations[:3]), np.radians(drift.deviations[3:])
    apart = np.array([0.0, move[0], move[1]]) * rig.baseline
    return dataclasses.replace(
        rig.deviations, om=np.hypot(rig.deviations.om, turn), T=np.hypot(rig.deviations.T, apart)
    )


def _in_words(drift: Drift, free: tuple[int, ...], before: float, after: float, features: int) -> str:
    numbers = np.concatenate([drift.turn, drift.move])
    found = [f"{name} {numbers[i]:+.2f} ± {drift.deviations[i]:.2f}" for i, name in enumerate(NAMES) if i in free]
    hidden = [name for i, name in enumerate(NAMES) if i not in free]
    stays = f"; {', '.join(hidden)} do not show in this pair and stay" if hidden else ""
    moved = f" and moved by {drift.move_deg:.2f} as seen from the left one" if DOWN in free else ""
    found_in = f"{', '.join(found)}{stays}"
    return (
        f"the right camera turned by {drift.turn_deg:.2f} degrees{moved} ({found_in}): rows of features held out differ"
        f" by {after:.2f} px, before by {before:.2f} px (medians of {features})"
    )
