"""Does a rectified pair hold together? Matched features tell whether rows correspond and left is left."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereo_gpu.epipolar.consensus import agreeing, enough
from stereo_gpu.epipolar.faults import BEHIND, share_behind
from stereo_gpu.epipolar.features import WORKING_SIDE
from stereo_gpu.epipolar.rows import Rows
from stereo_gpu.epipolar.sharpen import match_sharply
from stereo_gpu.errors import InputError
from stereo_gpu.images import check_pair
from stereo_gpu.types import Picture


@dataclass(frozen=True, kw_only=True)
class PairCheck:
    """What matched features tell of a rectified pair.

    Args:
        matches: how many features were matched.
        vertical_px: median distance between the rows of those that agree, px; NaN with too few.
        behind: share of them whose disparity would put them behind the cameras; NaN with too few.
    """

    matches: int
    vertical_px: float
    behind: float

    @property
    def swapped(self) -> bool:
        """Whether left and right look exchanged: nearly every point lies behind the cameras."""
        return self.behind > BEHIND


def check_rectified(left: Picture, right: Picture, *, offset_px: float = 0.0) -> PairCheck:
    """Match SIFT features between two rectified pictures of one size, of which no geometry need be known.

    With a rig, `check_rig` says more: it names what is wrong.

    Args:
        left, right: (H, W) or (H, W, 3), uint8 or uint16.
        offset_px: disparity of a point at infinity, cx_left - cx_right.

    Raises:
        PictureError: they are no such pictures.
    """
    check_pair(left, right)
    points_left, points_right = match_sharply(left, right)
    side = max(left.shape[:2])
    apart = points_left - points_right
    # The frame's longer side serves as focal length, which only sets how places and disparities are weighed.
    rows = Rows(vertical=apart[:, 1], disparity=apart[:, 0] - offset_px, at=points_left / side)
    good = agreeing(rows, side, scale=max(1.0, side / WORKING_SIDE))
    if not enough(good):
        return PairCheck(matches=len(apart), vertical_px=float("nan"), behind=float("nan"))
    kept = Rows(vertical=rows.vertical[good], disparity=rows.disparity[good], at=rows.at[good])
    return PairCheck(matches=len(apart), vertical_px=float(np.median(np.abs(kept.vertical))), behind=share_behind(kept))


def refuse_swapped(check: PairCheck) -> None:
    """Refuse a pair whose left and right pictures look exchanged.

    Raises:
        InputError: with the share of points that would lie behind the cameras.
    """
    if check.swapped:
        raise InputError(
            f"the pictures look swapped: {check.behind:.0%} of {check.matches} matched points would lie behind the"
            " cameras; give the left camera's picture first"
        )
