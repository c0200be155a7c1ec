"""From pictures of a board to a rig: each camera by itself, then both together, and how certain all of it is."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Literal

import numpy as np

from stereo_gpu.boards.board import Board
from stereo_gpu.boards.board_pairs import Progress, Source, find_pairs
from stereo_gpu.calibration.advice import advise, refuse_undetermined
from stereo_gpu.calibration.fit import Fit, fit_pairs
from stereo_gpu.calibration.lens_models import LensModels, choose_lens_model
from stereo_gpu.calibration.outcome import Calibration
from stereo_gpu.calibration.summary import describe_views, make_rig
from stereo_gpu.calibration.uncertainty import (
    depth_deviations,
    depth_slopes,
    find_deviations,
    shared_covariance,
    working_places,
)
from stereo_gpu.errors import CalibrationError, InputError
from stereo_gpu.rig import DISTORTION_COUNTS, Rig
from stereo_gpu.types import Doubles

SHORTEST_BASELINE = 1e-3  # of the distance to the boards

Coefficients = int | Literal["auto"]

logger = logging.getLogger(__name__)


def calibrate(
    left: Sequence[Source],
    right: Sequence[Source],
    board: Board,
    *,
    coefficients: Coefficients = "auto",
    progress: Progress | None = None,
) -> Rig:
    """Calibrate two cameras from pictures of a board; arguments and errors are those of `calibrate_in_full`."""
    return calibrate_in_full(left, right, board, coefficients=coefficients, progress=progress).rig


def calibrate_in_full(
    left: Sequence[Source],
    right: Sequence[Source],
    board: Board,
    *,
    coefficients: Coefficients = "auto",
    progress: Progress | None = None,
    first_number: int = 1,
) -> Calibration:
    """Calibrate two cameras from pictures of a board, and tell all that was found on the way.

    Each camera is calibrated by itself (Zhang 2000), then both together with all parameters free. Pairs that
    fit far worse than the typical one are left out, with the reason in `views`.

    Args:
        left, right: files or pictures, the pairs in one order; every picture of one camera of one size.
        board: what they show.
        coefficients: 5, 8 or 12 numbers for the lens distortion; "auto" for the fewest that predict views left out
            as well as any number does.
        progress: told how many of the pictures have been searched, and how many there are.
        first_number: of the first pair, as messages count them, where these are some of more pairs.

    Raises:
        InputError: the lists or `coefficients` are wrong.
        PictureError: a picture cannot be read, or a camera's pictures differ in size.
        CalibrationError: the pictures do not show such a board often enough, or give no sensible rig; where it can
            be told, with what is wrong: pictures swapped, mirrored or shifted, cameras that moved, too few tilts.
    """
    if coefficients != "auto" and (isinstance(coefficients, bool) or coefficients not in DISTORTION_COUNTS):
        raise InputError(f"coefficients is {coefficients!r:.60}: give 5, 8, 12 or auto")
    found, sizes = find_pairs(left, right, board, progress, first_number)
    models: LensModels | None = None
    if coefficients == "auto":
        coefficients = DISTORTION_COUNTS[0]
        fit = fit_pairs(found, sizes, board, coefficients)
        models = choose_lens_model(fit)
        if models.chosen != coefficients:
            # From all pairs again: a lens that the simplest model does not fit may have cost some of them.
            fit = fit_pairs(found, sizes, board, models.chosen)
    else:
        fit = fit_pairs(found, sizes, board, coefficients)
    covariance = shared_covariance(fit.normal, fit.count)
    deviations = find_deviations(fit.bundle, covariance)
    refuse_undetermined(fit, deviations, board, sizes)
    rig = make_rig(fit, sizes, board, deviations)
    _refuse_nonsense(rig, fit.distance)
    logger.info(
        "calibrated: %d of %d pairs, %.3f px, baseline %.4g %s",
        len(fit.used),
        len(fit.pairs),
        rig.rms_px,
        rig.baseline,
        rig.unit,
    )
    return Calibration(
        rig=rig,
        board=board,
        views=describe_views(fit, board),
        deviations=deviations,
        advice=advise(fit, rig, deviations, board),
        models=models,
        depth=_depth(fit, covariance, sizes),
    )


def _depth(fit: Fit, covariance: Doubles, sizes: Sequence[tuple[int, int]]) -> tuple[float, float]:
    """A depth amid the boards, and how certain the calibration makes it."""
    slopes = depth_slopes(fit.bundle, working_places(fit.bundle, sizes, [fit.distance]))
    return fit.distance, float(np.median(depth_deviations(slopes, covariance)))


def _refuse_nonsense(rig: Rig, distance: float) -> None:
    """Make sure that the cameras stand apart, and in order."""
    shift = ", ".join(f"{value:.4g}" for value in rig.T)
    if rig.baseline < SHORTEST_BASELINE * distance:
        raise CalibrationError(
            f"T = ({shift}) {rig.unit}: the cameras stand at one point; are left and right the same pictures?"
        )
    right_camera = -rig.R.T @ rig.T  # where it stands in the left camera's frame
    if -right_camera[0] == np.abs(right_camera).max():
        raise CalibrationError(
            f"left and right look swapped, or both cameras mirror their pictures: T = ({shift}) {rig.unit}, where T[0]"
            " must be below zero, as X_right = R X_left + T; give them the other way round, or turn mirroring off"
        )
