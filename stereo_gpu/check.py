"""Does a rectified pair hold together? Matched features tell whether rows correspond and left is left."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.images import grey
from stereo_gpu.types import Picture

WIDEST = 1600  # px; larger pictures are shrunk for the features
ENOUGH = 20  # matches, below which nothing is concluded
LOWES_RATIO = 0.75  # of the best to the second best descriptor distance


@dataclass(frozen=True, kw_only=True)
class PairCheck:
    """What matched features tell of a rectified pair.

    Args:
        matches: how many features were matched.
        vertical_px: median distance between the rows of matched features, px; NaN with too few matches.
        behind: share of the matches whose disparity would put them behind the cameras; NaN with too few.
    """

    matches: int
    vertical_px: float
    behind: float

    @property
    def swapped(self) -> bool:
        """Whether left and right look exchanged: the rows fit, and nearly every point lies behind the cameras."""
        return self.matches >= ENOUGH and self.behind > 0.8


def check_rectified(left: Picture, right: Picture, *, offset_px: float = 0.0) -> PairCheck:
    """Match SIFT features (Lowe 2004), by ratio and cross check, between two rectified pictures of one size.

    Args:
        left, right: (H, W) or (H, W, 3), uint8 or uint16.
        offset_px: disparity of a point at infinity, cx_left - cx_right.
    """
    shrink = min(1.0, WIDEST / left.shape[1])
    sift = cv2.SIFT.create(4000)
    found = []
    for picture in (left, right):
        small = cv2.resize(grey(picture), None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
        found.append(sift.detectAndCompute(small, None))
    (keys_left, about_left), (keys_right, about_right) = found
    if about_left is None or about_right is None or min(len(keys_left), len(keys_right)) < 2:
        return PairCheck(matches=0, vertical_px=float("nan"), behind=float("nan"))
    matcher = cv2.BFMatcher(cv2.NORM_L2)
    forward = [
        a.queryIdx for a, b in matcher.knnMatch(about_left, about_right, k=2) if a.distance < LOWES_RATIO * b.distance
    ]
    best = {m.queryIdx: m.trainIdx for m in matcher.match(about_left, about_right)}
    back = {m.queryIdx: m.trainIdx for m in matcher.match(about_right, about_left)}
    pairs = [(i, best[i]) for i in forward if back[best[i]] == i]
    if len(pairs) < ENOUGH:
        return PairCheck(matches=len(pairs), vertical_px=float("nan"), behind=float("nan"))
    at_left = np.array([keys_left[i].pt for i, _ in pairs]) / shrink
    at_right = np.array([keys_right[j].pt for _, j in pairs]) / shrink
    return PairCheck(
        matches=len(pairs),
        vertical_px=float(np.median(np.abs(at_left[:, 1] - at_right[:, 1]))),
        behind=float((at_left[:, 0] - at_right[:, 0] - offset_px < 0).mean()),
    )


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
