"""One camera calibrated by itself (Zhang 2000)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stereo_gpu.boards.board import Board, BoardView
from stereo_gpu.boards.board_pairs import BoardPair
from stereo_gpu.calibration.bundle import Corners
from stereo_gpu.calibration.outliers import drop_outliers, used_pairs
from stereo_gpu.calibration.pairing import LensView
from stereo_gpu.calibration.uncertainty import focal_share
from stereo_gpu.calibration.undetermined import UNDETERMINED_ALONE, undetermined
from stereo_gpu.errors import CalibrationError
from stereo_gpu.types import Doubles

SIDES = ("left", "right")
LENS_FLAGS = {5: 0, 8: cv2.CALIB_RATIONAL_MODEL, 12: cv2.CALIB_RATIONAL_MODEL | cv2.CALIB_THIN_PRISM_MODEL}
STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 200, 1e-9)


@dataclass(frozen=True)
class Lens:
    """One camera calibrated by itself.

    Args:
        matrix, distortion: (3, 3) px and (n,).
        views: the pairs that were in, with the board's poses.
        rms_px: over all corners.
    """

    matrix: Doubles
    distortion: Doubles
    views: list[LensView]
    rms_px: float

    @property
    def numbers(self) -> Doubles:
        """(4 + n,): fx fy cx cy, then the distortion."""
        matrix = self.matrix
        return np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *self.distortion])


def calibrate_lenses(
    pairs: list[BoardPair], sizes: list[tuple[int, int]], board: Board, coefficients: int
) -> tuple[Lens, Lens]:
    """Calibrate each camera by itself, from the same pairs; those that do not fit are left out.

    Raises:
        CalibrationError: too few pairs fit, or the boards give no calibration.
    """
    while True:
        left, right = (_calibrate_lens(pairs, side, sizes[side], board, coefficients) for side in (0, 1))
        # Again where one camera lost a pair that the other one still holds.
        if len(left.views) == len(right.views) == len(used_pairs(pairs)):
            return left, right


def seen_by(pairs: list[BoardPair], side: int) -> list[BoardView]:
    """What one camera saw in every pair that has it."""
    return [view for pair in pairs if (view := pair.views[side]) is not None]


def _calibrate_lens(pairs: list[BoardPair], side: int, size: tuple[int, int], board: Board, coefficients: int) -> Lens:
    while True:
        used = used_pairs(pairs)
        seen = seen_by(used, side)
        points = [board.points[view.ids] for view in seen]
        try:
            rms, matrix, distortion, turns, shifts = cv2.calibrateCamera(
                points,
                [view.corners for view in seen],
                size,
                None,
                None,
                flags=LENS_FLAGS[coefficients],
                criteria=STOP,
            )
        except cv2.error as error:
            raise CalibrationError(f"{SIDES[side]} camera: {degenerate(error)}") from error
        if not (np.isfinite(matrix).all() and np.isfinite(distortion).all() and np.isfinite(rms)):
            raise CalibrationError(f"{SIDES[side]} camera: {degenerate(None)}")
        views = [
            LensView(seen=view, rotation=cv2.Rodrigues(turn)[0], translation=shift.reshape(3))
            for view, turn, shift in zip(seen, turns, shifts, strict=True)
        ]
        lens = Lens(matrix, distortion.reshape(-1)[:coefficients].copy(), views, float(rms))
        # Before anything is left out: with parallel boards, poses are as wrong as the focal length.
        _refuse_undetermined(lens, side, size, board)
        distances = [
            np.linalg.norm(
                cv2.projectPoints(on_board, turn, shift, matrix, distortion)[0].reshape(-1, 2) - view.corners, axis=1
            )
            for on_board, turn, shift, view in zip(points, turns, shifts, seen, strict=True)
        ]
        if not drop_outliers(used, distances, f"does not fit the {SIDES[side]} camera"):
            return lens


def _refuse_undetermined(lens: Lens, side: int, size: tuple[int, int], board: Board) -> None:
    seen = [view.seen for view in lens.views]
    rotations = np.stack([view.rotation for view in lens.views])
    translations = np.stack([view.translation for view in lens.views])
    share = focal_share(lens.numbers, rotations, translations, Corners.of(seen, board))
    if not 0 <= share <= UNDETERMINED_ALONE:
        raise undetermined(SIDES[side], float(lens.matrix[0, 0]), share, seen, size, board)


def degenerate(error: cv2.error | None) -> str:
    """That the boards give no calibration, and the way out."""
    detail = f" ({' '.join(error.err.split())[:80]})" if error is not None else ""
    return f"the boards give no calibration{detail}: tilt the board in more directions, fill more of the picture"
