"""All that a calibration found: the rig, how certain it is, and what became of every pair."""

from __future__ import annotations

from dataclasses import dataclass

from stereo_gpu.boards.board import Board
from stereo_gpu.calibration.lens_models import LensModels
from stereo_gpu.deviations import Deviations
from stereo_gpu.rig import Rig
from stereo_gpu.types import Doubles, Floats, Ints


@dataclass(frozen=True, kw_only=True, eq=False)
class CalibrationView:
    """What became of one board pair.

    Args:
        left, right: names of the two pictures.
        used: whether the pair counts in the calibration.
        reason: why it was left out; empty where it is used.
        seen: (n, 2) px, the corners found in the left and in the right picture; None where no board was found.
        projected: the same corners where the final rig puts them; of a pair that is left out, where each camera alone
            would see them at best; None where no board was found.
        rotation: (3, 3), board to left camera frame; None where it is not known.
        translation: (3,), the same, in the board's unit.
        ids: (n,), which of the board's points the corners are; None where they are all of them in their order.
    """

    left: str
    right: str
    used: bool
    reason: str
    seen: tuple[Floats | None, Floats | None]
    projected: tuple[Floats | None, Floats | None]
    rotation: Doubles | None
    translation: Doubles | None
    ids: tuple[Ints | None, Ints | None] = (None, None)


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration:
    """A rig, and all that its calibration tells besides.

    Args:
        rig: the cameras; `rig.views` holds the errors of each pair.
        board: what the pictures show.
        views: every pair in the order given, with its corners and pose.
        deviations: of every parameter of the rig.
        advice: warnings, and the next best view, in words; one sentence each.
        models: what the numbers of lens coefficients were worth; None where the number was given.
        depth: a depth amid the boards, and the standard deviation that the calibration alone leaves there, median
            over the picture, both in the board's unit; None where it was not found.
    """

    rig: Rig
    board: Board
    views: tuple[CalibrationView, ...]
    deviations: Deviations
    advice: tuple[str, ...] = ()
    models: LensModels | None = None
    depth: tuple[float, float] | None = None
