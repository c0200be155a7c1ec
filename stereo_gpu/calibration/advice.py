"""What a calibration lacks, in words: what to mistrust in it, and which view to take next."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stereo_gpu.boards.board import Board
from stereo_gpu.boards.coverage import Coverage, missing_in_both
from stereo_gpu.calibration.fit import Fit
from stereo_gpu.calibration.lenses import SIDES, seen_by
from stereo_gpu.calibration.movement import out_of_step
from stereo_gpu.calibration.next_view import find_next_view
from stereo_gpu.calibration.uncertainty import working_places
from stereo_gpu.calibration.undetermined import UNDETERMINED, undetermined
from stereo_gpu.deviations import Deviations
from stereo_gpu.rig import DISTORTION_COUNTS, Rig

UNCERTAIN = 0.01  # deviation of a focal length, as a share of it: a poor one; careful ones have 0.0003 to 0.001
UNCERTAIN_DEGREES = 0.2  # of R: careful ones have 0.05 to 0.1
OUT_OF_STEP = 0.5  # of the squared error; good sets have 0.04 and 0.14
FEW_PAIRS = 10
HIGH_ERROR_PX = 1.0


def refuse_undetermined(fit: Fit, deviations: Deviations, board: Board, sizes: Sequence[tuple[int, int]]) -> None:
    """Refuse a fit whose focal lengths could be anything, with what the boards lack.

    Raises:
        CalibrationError: a focal length is more uncertain than that.
    """
    for side, (lens, found) in enumerate(zip(fit.bundle.lenses, (deviations.left, deviations.right), strict=True)):
        share = max(found.fx / lens[0], found.fy / lens[1])
        if not 0 <= share <= UNDETERMINED:
            raise undetermined(SIDES[side], lens[0], share, seen_by(fit.used, side), sizes[side], board)


def advise(fit: Fit, rig: Rig, deviations: Deviations, board: Board) -> tuple[str, ...]:
    """Warnings, then the next best view; one sentence each, empty where nothing is to be said."""
    sizes = rig.left.size, rig.right.size
    told = []
    if rig.rms_px > HIGH_ERROR_PX:
        told.append(
            f"the reprojection error is {rig.rms_px:.2f} px, good ones are below 0.3: look for a bent board, blur, or"
            " cameras that did not take their pictures at one moment"
        )
    if fit.move is not None:
        first = fit.used[fit.move.first]
        told.append(
            f"the cameras may have moved by {fit.move.degrees:.2f} degrees before {first.names[0]}: two rigs would"
            f" explain {fit.move.share:.0%} of the squared error; fasten them and take the pairs again"
        )
    elif (share := out_of_step(fit.normal)) > OUT_OF_STEP and len(fit.used) >= FEW_PAIRS // 2:
        told.append(
            f"{share:.0%} of the squared error comes from pairs that would each fit a rig of their own: hold the board"
            " still, or let both cameras take their pictures at one moment"
        )
    for side, (lens, found) in enumerate(zip(fit.bundle.lenses, (deviations.left, deviations.right), strict=True)):
        share = max(found.fx / lens[0], found.fy / lens[1])
        if share > UNCERTAIN:
            told.append(
                f"the focal length of the {SIDES[side]} camera is uncertain by {share:.1%}: tilt the board more"
            )
    turned = float(np.rad2deg(deviations.om.max()))
    if turned > UNCERTAIN_DEGREES:
        coefficients = len(rig.left.distortion)
        fewer = "fewer lens coefficients, or " if coefficients > DISTORTION_COUNTS[0] else ""
        told.append(
            f"how the cameras are turned to each other is uncertain by {turned:.2g} degrees with {coefficients} lens"
            f" coefficients: take {fewer}more pairs"
        )
    if len(fit.used) < FEW_PAIRS:
        told.append(f"{len(fit.used)} pairs are few: take {FEW_PAIRS} or more")
    lacks = missing_in_both(*_coverage(fit, board, sizes))
    common = [lack for lack in lacks[0] if lack in lacks[1]]
    own = [[lack for lack in ours if lack not in common] for ours in lacks]
    told += [
        f"in {where}: {'; '.join(ours)}"
        for where, ours in (("both pictures", common), *((f"the {SIDES[side]} pictures", own[side]) for side in (0, 1)))
        if ours
    ]
    information, _ = fit.normal.reduced()
    depths = fit.bundle.translations[:, 2]
    places = working_places(fit.bundle, sizes, [float(depths.min()), float(depths.max())])
    following = find_next_view(fit.bundle, information.sum(axis=0), places, sizes, board)
    if following is not None:
        told.append(following.told(board.unit))
    return tuple(told)


def _coverage(fit: Fit, board: Board, sizes: Sequence[tuple[int, int]]) -> tuple[Coverage, Coverage]:
    left, right = (Coverage(size, board) for size in sizes)
    for pair in fit.used:
        for coverage, view in zip((left, right), pair.views, strict=True):
            if view is not None:
                coverage.add(view)
    return left, right
