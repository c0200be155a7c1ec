"""Tell true matches from wrong ones by their rows, whatever is wrong with the rig."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_gpu.epipolar.rows import Rows
from stereo_gpu.types import Doubles

TRIALS = 500  # with 40 % of the matches true, twelve of them have no wrong one
ENOUGH, ENOUGH_SHARE = 20, 0.25  # matches that agree, below which nothing is concluded
NEAR_PX = 3.0  # of the smooth vertical error, at WORKING_SIDE or less
LINE_PX = 1.5  # from an epipolar line, at WORKING_SIDE or less
MOSTLY = 0.6  # share of the matches that two views of one thing agree on
SEED = 0


def agreeing(rows: Rows, focal: float, scale: float = 1.0) -> NDArray[np.bool_]:
    """(N,) which matches share one vertical error that is linear in place and disparity; no more than NEAR_PX off.

    A rig that is off by a few degrees, that is another's, or whose pictures are swapped, still gives an error that
    is smooth over the frame, while a wrong match lies anywhere. Four samples at a time, the lowest truncated error
    wins (MSAC: Torr and Zisserman, "MLESAC", 2000).

    Args:
        rows: of all matches; those that are not finite are left out.
        focal: px, of `rows`.
        scale: px of the picture for each px of the copy that the features were found on.
    """
    good = np.isfinite(rows.vertical) & np.isfinite(rows.disparity)
    known = np.flatnonzero(good)
    if len(known) < 4:
        return np.zeros(len(good), bool)
    terms = np.column_stack([np.ones(len(known)), rows.at[known], rows.disparity[known] / focal])
    vertical = rows.vertical[known]
    random = np.random.default_rng(SEED)
    samples = random.integers(0, len(known), (TRIALS, 4))
    matrices = terms[samples]
    # Four points in one plane, or one point twice, settle nothing; pinv then gives the smallest fit.
    fits = np.einsum("tij,tj->ti", np.linalg.pinv(matrices, rcond=1e-6), vertical[samples])
    errors = np.abs(terms @ fits.T - vertical[:, None])
    best = int(np.minimum(errors, NEAR_PX * scale).sum(axis=0).argmin())
    found = np.zeros(len(good), bool)
    found[known[errors[:, best] <= NEAR_PX * scale]] = True
    return found


def enough(good: NDArray[np.bool_]) -> bool:
    """Whether so many of the matches agree that it is no chance; `good` is (N,), as `agreeing` gives it."""
    return int(good.sum()) >= max(ENOUGH, ENOUGH_SHARE * len(good))


def agree_without_rig(points_left: Doubles, points_right: Doubles, scale: float = 1.0) -> bool:
    """Whether (N, 2) px places in the two pictures mostly fit one epipolar geometry, whichever (MAGSAC++, 2020)."""
    if len(points_left) < 2 * ENOUGH:
        return False
    try:
        _, inliers = cv2.findFundamentalMat(points_left, points_right, cv2.USAC_MAGSAC, LINE_PX * scale, 0.999, 5000)
    except cv2.error:  # some versions fail on matches that no F fits
        return False
    return inliers is not None and float(np.mean(inliers != 0)) >= MOSTLY
