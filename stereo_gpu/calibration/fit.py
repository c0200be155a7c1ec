"""From found boards to one fit of both cameras: each by itself, how they stand, then everything together."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stereo_gpu.boards.board import Board
from stereo_gpu.boards.board_pairs import BoardPair
from stereo_gpu.calibration.bundle import Bundle, Corners, Normal, linearise, refine, residuals
from stereo_gpu.calibration.lenses import Lens, calibrate_lenses, degenerate, seen_by
from stereo_gpu.calibration.mismatch import explain_mismatch, moved
from stereo_gpu.calibration.movement import Move, find_move, find_split
from stereo_gpu.calibration.outliers import drop, drop_outliers, used_pairs
from stereo_gpu.calibration.pairing import propose
from stereo_gpu.calibration.undetermined import missing_tilts
from stereo_gpu.errors import CalibrationError
from stereo_gpu.types import Doubles

CARRIED_FACTOR = 10.0  # a board carried over with another view's R and T fits worse than it will after all views
CARRIED_LIMIT = 0.02  # of the picture's width: worse than that, the pairs do not belong together
TOGETHER_FACTOR = 3.0  # the cameras together fit so many times worse than each alone: they do not belong together
TOGETHER_FLOOR_PX = 1.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Fit:
    """Both cameras and all poses, fitted to the pairs that fit.

    Args:
        pairs: all that were given, with the reason where one is left out; right corners have the left ones' ids.
        bundle: the fit; its views are the pairs in use.
        corners: of the left and the right camera, of the pairs in use.
        normal: the normal equations there.
        move: where the cameras may have moved; None if there is no sign of it.
    """

    pairs: list[BoardPair]
    bundle: Bundle
    corners: tuple[Corners, Corners]
    normal: Normal
    move: Move | None

    @property
    def used(self) -> list[BoardPair]:
        """The pairs in use."""
        return [pair for pair in self.pairs if not pair.reason]

    @property
    def count(self) -> int:
        """How many corners there are, in both pictures of all pairs."""
        return len(self.corners[0].seen) + len(self.corners[1].seen)

    @property
    def distance(self) -> float:
        """Median depth of the boards before the left camera."""
        return float(np.median(self.bundle.translations[:, 2]))


def fit_pairs(found: list[BoardPair], sizes: list[tuple[int, int]], board: Board, coefficients: int) -> Fit:
    """Calibrate from the pairs in which boards were found, leaving out those that do not fit.

    Args:
        found: every pair; not changed.
        sizes: of the left and the right pictures, px.
        board: what they show.
        coefficients: 5, 8 or 12 numbers for the lens distortion.

    Raises:
        CalibrationError: the pairs give no calibration; with what is wrong with them, where it can be told.
    """
    pairs = [replace(pair, views=list(pair.views)) for pair in found]
    lenses = calibrate_lenses(pairs, sizes, board, coefficients)
    bundle = _stand(pairs, lenses, board, sizes)
    first = True
    while True:
        used = used_pairs(pairs)
        corners = Corners.of(seen_by(used, 0), board), Corners.of(seen_by(used, 1), board)
        bundle = refine(bundle, corners)
        normal = linearise(bundle, corners)
        if not np.isfinite(normal.squares):
            raise CalibrationError(degenerate(None))
        move = find_move(normal, len(corners[0].seen) + len(corners[1].seen))
        if move is not None and move.sure:
            raise CalibrationError(moved(pairs, move.first, f" by {move.degrees:.2f} degrees against each other"))
        distances = both_distances(bundle, corners)
        if first:
            _refuse_strangers(pairs, lenses, distances, board, sizes)
        first = False
        if not drop_outliers(used, distances, "left and right do not fit together"):
            return Fit(pairs=pairs, bundle=bundle, corners=corners, normal=normal, move=move)
        bundle = bundle.only([number for number, pair in enumerate(used) if not pair.reason])


def view_distances(bundle: Bundle, corners: tuple[Corners, Corners]) -> tuple[list[Doubles], list[Doubles]]:
    """For the left and the right camera, of each view, (n,) px between every corner and where the model puts it."""
    left, right = (
        [np.linalg.norm(off[ours.view == view], axis=1) for view in range(len(bundle.rotations))]
        for off, ours in zip(residuals(bundle, corners), corners, strict=True)
    )
    return left, right


def both_distances(bundle: Bundle, corners: tuple[Corners, Corners]) -> list[Doubles]:
    """The same of each view, both pictures together."""
    return [np.concatenate(pair) for pair in zip(*view_distances(bundle, corners), strict=True)]


def _stand(pairs: list[BoardPair], lenses: tuple[Lens, Lens], board: Board, sizes: list[tuple[int, int]]) -> Bundle:
    """Settle which end of the board is which, leave out pairs that do not belong together; where to start."""
    used = used_pairs(pairs)
    left, right = lenses
    proposals = propose(left.views, right.views, board, right.matrix, right.distortion)
    agreement = proposals.agreement()
    errors, typical = agreement.errors_px, float(np.median(agreement.errors_px))
    width = sizes[1][0]
    if not typical <= CARRIED_LIMIT * width:
        raise _strangers(pairs, lenses, board, sizes, typical)
    limit = max(CARRIED_FACTOR * typical, CARRIED_LIMIT / 4 * width)
    bad = np.flatnonzero(errors > limit).tolist()
    if len(bad) > 1 and (split := find_split(proposals)) is not None:
        raise CalibrationError(moved(pairs, split))
    for pair, view in zip(used, agreement.right, strict=True):
        pair.views[1] = view
    drop(used, errors, bad, "left and right do not belong together, or the cameras or the board moved")
    kept = [number for number in range(len(used)) if number not in bad]
    return Bundle(
        lenses=(left.numbers, right.numbers),
        R=agreement.R,
        T=agreement.T,
        rotations=np.stack([view.rotation for view in left.views]),
        translations=np.stack([view.translation for view in left.views]),
    ).only(kept)


def _refuse_strangers(
    pairs: list[BoardPair],
    lenses: tuple[Lens, Lens],
    distances: list[Doubles],
    board: Board,
    sizes: list[tuple[int, int]],
) -> None:
    """Refuse pairs of which most fit each camera, but not both together."""
    together = float(np.median([np.sqrt((off**2).mean()) for off in distances]))
    if together > max(TOGETHER_FLOOR_PX, TOGETHER_FACTOR * max(lens.rms_px for lens in lenses)):
        raise _strangers(pairs, lenses, board, sizes, together)


def _strangers(
    pairs: list[BoardPair], lenses: tuple[Lens, Lens], board: Board, sizes: list[tuple[int, int]], off_px: float
) -> CalibrationError:
    """That the pairs do not belong together, and why, where it can be told."""
    width = sizes[1][0]
    told = None
    if len(lenses[0].views) == len(used_pairs(pairs)):
        told = explain_mismatch(pairs, lenses, board, width, CARRIED_LIMIT * width)
    if told is None:
        tilts = missing_tilts([view.seen for view in lenses[0].views], sizes[0], board)
        also = f"; or tilt the board more, since {' and '.join(tilts)}" if tilts else ""
        told = (
            f"the pairs do not agree on one rig (typically {off_px:.3g} px off): give left and right pictures in the"
            " same order, take both at the same moment, and leave the cameras where they are between pairs" + also
        )
    return CalibrationError(told)
