"""Place matched features more exactly: whatever surrounds the left one is found again around the right one."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from stereo_gpu.epipolar.features import WORKING_SIDE, match_features
from stereo_gpu.images import grey
from stereo_gpu.types import Bytes, Doubles, Floats, Picture

LARGEST_SIDE = 4096  # px: larger pictures are shrunk to this, for the memory that gradients take
WINDOW = 21  # px
LOCAL = 35  # px: side of the box over which brightness and contrast are levelled
NOISE = 2.0  # grey levels: contrast below this is not raised
SHORT = 3.0  # px of the picture that the features were found on: how far one may move
THERE_AND_BACK = 0.3  # px: how far from its start a feature may come back


def match_sharply(left: Picture, right: Picture) -> tuple[Doubles, Doubles]:
    """`match_features`, placed exactly by `sharpen_matches`.

    Raises:
        PictureError: one of the two is no picture.
    """
    return sharpen_matches(left, right, *match_features(left, right))


def sharpen_matches(
    left: Picture, right: Picture, points_left: Doubles, points_right: Doubles
) -> tuple[Doubles, Doubles]:
    """Move the right points to where their surroundings fit those of the left ones best; drop what does not fit.

    SIFT places a feature to about a third of a pixel of the scale that it was found on, in each picture by itself.
    Comparing the pictures halves the error of the difference, and in large ones, whose features are found on a
    smaller copy, reaches the full resolution. Brightness and contrast are levelled first, as the cameras' differ.

    Args:
        left, right: (H, W) or (H, W, 3), uint8 or uint16.
        points_left, points_right: (N, 2) px, as `match_features` gives them.

    Returns:
        The two, (M, 2) px, M <= N, in the same order.

    Source: Lucas and Kanade, "An Iterative Image Registration Technique" (1981); there and back as in Kalal et al.,
    "Forward-Backward Error" (2010).
    """
    if not len(points_left):
        return points_left, points_right
    level_left, scale_left = _levelled(left)
    level_right, scale_right = _levelled(right)
    start = _to(points_left, scale_left)
    guess = _to(points_right, scale_right)
    track: dict[str, Any] = {
        "winSize": (WINDOW, WINDOW),
        "maxLevel": 1,
        "criteria": (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 0.005),
        "flags": cv2.OPTFLOW_USE_INITIAL_FLOW,
    }
    there, found, _ = cv2.calcOpticalFlowPyrLK(level_left, level_right, start, guess.copy(), **track)
    back, returned, _ = cv2.calcOpticalFlowPyrLK(level_right, level_left, there, start.copy(), **track)
    # Of a larger picture the features were found on a smaller copy, and are off by as many more px.
    reach = SHORT * max(1.0, max(level_right.shape) / WORKING_SIDE)
    good = (
        (found.ravel() == 1)
        & (returned.ravel() == 1)
        & (np.linalg.norm(back - start, axis=2).ravel() <= THERE_AND_BACK)
        & (np.linalg.norm(there - guess, axis=2).ravel() <= reach)
    )
    placed: Doubles = (there.reshape(-1, 2).astype(np.float64)[good] + 0.5) / scale_right - 0.5
    return points_left[good], placed


def _levelled(picture: Picture) -> tuple[Bytes, Doubles]:
    """The grey picture, shrunk if it is huge, with local mean and contrast made the same all over; and its scale."""
    flat = grey(picture)
    shrink = min(1.0, LARGEST_SIDE / max(flat.shape))
    size = [max(1, round(side * shrink)) for side in flat.shape[::-1]]
    small = cv2.resize(flat, size, interpolation=cv2.INTER_AREA) if shrink < 1 else flat
    values = small.astype(np.float32)
    values -= cv2.blur(values, (LOCAL, LOCAL))
    # The box's running sums may end a hair below zero where all is flat.
    spread = np.sqrt(np.maximum(cv2.blur(values * values, (LOCAL, LOCAL)), 0))
    levelled: Bytes = np.clip(values / (spread + NOISE) * 40 + 128, 0, 255).astype(np.uint8)
    return levelled, np.array(size, np.float64) / flat.shape[::-1]


def _to(points: Doubles, scale: Doubles) -> Floats:
    """Points in the pixels of a picture scaled by `scale`, as OpenCV's tracker takes them, (N, 1, 2)."""
    return ((points + 0.5) * scale - 0.5).astype(np.float32).reshape(-1, 1, 2)
