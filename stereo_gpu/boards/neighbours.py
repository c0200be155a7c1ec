"""Corners of a board that do not lie where their neighbours say: an edge of a marker or of glare was taken for them."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_gpu.types import Floats, Ints

NEIGHBOURS = 8  # on the board, that say where a corner must be
FARTHEST_PX = 0.6  # a corner may always be as far off: neighbours are off as well, and lenses bend
FARTHEST_FACTOR = 5.0  # of the median distance in the view


def fits_neighbours(corners: Floats, places: Ints) -> NDArray[np.bool_]:
    """(n,): which corners lie where the homography of their nearest neighbours has them.

    The worst is left out first, and its neighbours are judged again without it.

    Args:
        corners: (n, 2) px.
        places: (n, 2) column and row on the board.
    """
    kept = np.ones(len(corners), bool)
    apart = np.linalg.norm((places[:, None] - places[None]).astype(np.float64), axis=-1)
    off = np.array([_distance(number, corners, places, apart, kept) for number in range(len(corners))])
    limit = max(FARTHEST_PX, FARTHEST_FACTOR * float(np.median(off)))
    while kept.sum() > NEIGHBOURS and off.max() > limit:
        worst = int(off.argmax())
        kept[worst] = False
        off[worst] = 0.0
        # Whoever asked it is asked again.
        for number in np.flatnonzero(kept & (apart[worst] <= NEIGHBOURS / 2)).tolist():
            off[number] = _distance(number, corners, places, apart, kept)
    return kept


def _distance(number: int, corners: Floats, places: Ints, apart: NDArray[np.float64], kept: NDArray[np.bool_]) -> float:
    """Px between a corner and where its nearest neighbours have it; 0 where they fix no plane."""
    others = np.flatnonzero(kept)
    others = others[others != number]
    near = others[np.argsort(apart[number, others], kind="stable")[:NEIGHBOURS]]
    if len(near) < NEIGHBOURS or np.linalg.matrix_rank(places[near] - places[near].mean(axis=0)) < 2:
        return 0.0
    matrix, _ = cv2.findHomography(places[near].astype(np.float64), corners[near].astype(np.float64))
    if matrix is None:
        return 0.0
    x, y, w = matrix @ (*places[number], 1.0)
    return float(np.hypot(x / w - corners[number, 0], y / w - corners[number, 1])) if w else 0.0
