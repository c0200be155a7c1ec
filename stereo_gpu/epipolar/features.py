"""Find the same points in two pictures, knowing nothing of the cameras."""

from __future__ import annotations

import cv2
import numpy as np

from stereo_gpu.images import check_picture, grey
from stereo_gpu.types import Bytes, Doubles, Floats, Picture

WORKING_SIDE = 1600  # px: features of larger pictures are found on a smaller copy
MOST = 4000  # features a picture
CONTRAST = 0.02  # half of Lowe's, for plain things on a desk
RATIO = 0.75  # of the best to the second best descriptor distance; Lowe 2004, section 7.1, took 0.8


def match_features(left: Picture, right: Picture) -> tuple[Doubles, Doubles]:
    """Match SIFT features (Lowe 2004) by ratio and cross check; a tenth to a third of the matches are wrong.

    Args:
        left, right: (H, W) or (H, W, 3), uint8 or uint16; they may differ in size.

    Returns:
        (N, 2) px places in the left picture and in the right one, sub-pixel, pixel centres at whole numbers;
        no place twice. N is 0 where nothing matches.

    Raises:
        PictureError: one of them is no picture.
    """
    places, descriptors = zip(*(_describe(name, p) for name, p in (("left", left), ("right", right))), strict=True)
    if min(len(side) for side in descriptors) < 2:  # no second best to compare with
        return np.zeros((0, 2)), np.zeros((0, 2))
    matcher = cv2.BFMatcher(cv2.NORM_L2)
    back = {match.queryIdx: match.trainIdx for match in matcher.match(descriptors[1], descriptors[0])}
    pairs = [
        (best.queryIdx, best.trainIdx)
        for best, second in matcher.knnMatch(descriptors[0], descriptors[1], k=2)
        if best.distance < RATIO * second.distance and back[best.trainIdx] == best.queryIdx
    ]
    chosen = np.array(pairs, np.intp).reshape(-1, 2)
    points = np.hstack([places[0][chosen[:, 0]], places[1][chosen[:, 1]]])
    # SIFT lists a place once for each of its orientations.
    points = np.unique(points, axis=0)
    return points[:, :2].copy(), points[:, 2:].copy()


def _describe(name: str, picture: Picture) -> tuple[Doubles, Floats]:
    """Places of the features, (N, 2) px, and their descriptors, (N, 128)."""
    check_picture(name, picture)
    flat = grey(picture)
    small = _shrunk(flat)
    sift = cv2.SIFT.create(MOST, contrastThreshold=CONTRAST, enable_precise_upscale=True)
    keys, descriptors = sift.detectAndCompute(small, None)
    if descriptors is None:
        return np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    scale = np.array(small.shape[::-1]) / flat.shape[::-1]
    places: Doubles = (np.array([key.pt for key in keys], np.float64) + 0.5) / scale - 0.5
    return places, descriptors


def _shrunk(flat: Bytes) -> Bytes:
    scale = WORKING_SIDE / max(flat.shape)
    if scale >= 1:
        return flat
    width, height = (max(1, round(side * scale)) for side in flat.shape[::-1])
    small: Bytes = cv2.resize(flat, (width, height), interpolation=cv2.INTER_AREA)
    return small
