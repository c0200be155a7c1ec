"""Match features of a rectified pair along its rows: few disparities, from pictures that are mostly blank too."""

from __future__ import annotations

import cv2
import numpy as np

from stereo_gpu.types import Bytes, Doubles

MOST = 1000  # features a picture
CONTRAST = 0.02  # half of SIFT's own threshold
ROW_PX = 1.5  # rows of partners differ by no more
RATIO = 0.85  # of the best to the second best descriptor distance, along one row
SAME_PX = 3.0  # features no farther apart are no rivals: SIFT gives one place several orientations
NEIGHBOURS = 3  # that must share a match's disparity
AROUND, AGREE = 0.06, 0.01  # of the width: how far away they may be, and differ


def match_sparse(pictures: list[Bytes], masks: list[Bytes], smallest: int, disparities: int) -> Doubles:
    """Disparities of SIFT features (Lowe 2004) that match along a row and whose neighbours agree, sorted, px.

    Args:
        pictures: left and right, (H, W) uint8.
        masks: of the left and right picture, (H, W), 0 where it has no content.
        smallest, disparities: the range to search.
    """
    nothing = np.zeros(0)
    sift = cv2.SIFT.create(MOST, contrastThreshold=CONTRAST)
    keys, about = zip(*(sift.detectAndCompute(p, m) for p, m in zip(pictures, masks, strict=True)), strict=True)
    if about[0] is None or about[1] is None:
        return nothing
    left, right = (np.array([key.pt for key in side]) for side in keys)
    unit = [side / np.linalg.norm(side, axis=1, keepdims=True) for side in about]
    distance = np.sqrt(np.maximum(0, 2 - 2 * unit[0] @ unit[1].T))
    disparity = left[:, :1] - right[:, 0]
    impossible = (np.abs(left[:, 1:] - right[:, 1]) > ROW_PX) | (disparity < smallest)
    distance[impossible | (disparity > smallest + disparities - 1)] = np.inf
    ours, best = np.arange(len(left)), distance.argmin(1)
    rivals = np.where(np.abs(right[best][:, :1] - right[:, 0]) < SAME_PX, np.inf, distance).min(1)
    reached = distance[ours, best]
    good = np.isfinite(reached) & (reached < RATIO * rivals) & (distance.argmin(0)[best] == ours)
    places, found = left[good], disparity[ours, best][good]
    width = pictures[0].shape[1]
    close = np.abs(places[:, None] - places).max(2, initial=0) < AROUND * width
    shared = close & (np.abs(found[:, None] - found) < AGREE * width)
    return np.sort(found[shared.sum(1) > NEIGHBOURS])
