"""Boards that leave a focal length undetermined: what they lack, in words."""

from __future__ import annotations

from collections.abc import Iterable

from stereo_gpu.boards.board import Board, BoardView
from stereo_gpu.boards.coverage import Coverage
from stereo_gpu.errors import CalibrationError

UNDETERMINED = 0.05  # deviation of a focal length, as a share of it, above which there is no calibration
UNDETERMINED_ALONE = 0.15  # the same of one camera by itself; both together know more


def undetermined(
    side: str, focal_px: float, share: float, views: Iterable[BoardView], size: tuple[int, int], board: Board
) -> CalibrationError:
    """That a camera's focal length could be anything, and the way out.

    Args:
        side: "left" or "right".
        focal_px: what was found.
        share: its deviation, as a share of it.
        views: what the camera saw.
        size: of its pictures, px.
        board: what they show.
    """
    tilts = missing_tilts(views, size, board)
    why = f" ({'; '.join(tilts)})" if tilts else ""
    told = f"a deviation of {share:.0%}" if share < 1 else "a deviation larger than itself"
    return CalibrationError(
        f"the focal length of the {side} camera is not determined: {focal_px:.0f} px with {told}{why}; take more pairs,"
        " with the board tilted by 30 degrees to the left, right, top and bottom"
    )


def missing_tilts(views: Iterable[BoardView], size: tuple[int, int], board: Board) -> list[str]:
    """In which directions no view shows the board tilted, in words."""
    coverage = Coverage(size, board)
    for view in views:
        coverage.add(view)
    return [lack for lack in coverage.missing() if "tilt" in lack]
