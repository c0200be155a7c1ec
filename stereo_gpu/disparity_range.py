"""Find which disparities a pair has, so that nobody needs to know them: a coarse match over nearly all of them."""

from __future__ import annotations

import dataclasses
import logging

import cv2
import numpy as np

from stereo_gpu.backends import Backend
from stereo_gpu.config import PROFILES, Profile
from stereo_gpu.match import match_on
from stereo_gpu.prepare import grey_scale
from stereo_gpu.timing import Stopwatch
from stereo_gpu.types import Bytes, Picture, View

_log = logging.getLogger(__name__)

COARSE_WIDTH = 320  # px; small enough to search everything, large enough for a window to hold texture
SMALLEST_SHARE = 0.001  # of the matched pixels: fewer at one coarse disparity are taken for false matches
MARGIN = 2  # coarse px on either side, for what the coarse picture could not resolve
# Shares of the found range that are added. Near surfaces are the ones that a coarse match loses: they are cut off
# by the picture's edge, thin, or seen at a slant.
FARTHER, NEARER = 0.05, 0.15
_COARSE = dataclasses.replace(PROFILES[Profile.FAST], fill_reach=0)


def find_range(
    backend: Backend, left: Picture, right: Picture, valid_left: Bytes, valid_right: Bytes
) -> tuple[int, int]:
    """Find the disparity range of a rectified pair.

    Args:
        backend: where to compute.
        left, right: rectified pictures of one size.
        valid_left, valid_right: (H, W), 0 where a picture has no content.

    Returns:
        Smallest disparity and how many, px. Searched are a quarter of the width below 0 and three quarters above.
    """
    factor = max(1, -(-left.shape[1] // COARSE_WIDTH))
    size = (max(1, left.shape[1] // factor), max(1, left.shape[0] // factor))
    pictures = [cv2.resize(picture, size, interpolation=cv2.INTER_AREA) for picture in (left, right)]
    masks = [cv2.resize(mask, size, interpolation=cv2.INTER_NEAREST) for mask in (valid_left, valid_right)]
    smallest, count = -(size[0] // 4), max(1, size[0])
    found = match_on(
        backend,
        backend.upload(pictures[0]),
        backend.upload(pictures[1]),
        scales=(grey_scale(pictures[0]), grey_scale(pictures[1])),
        masks=(backend.upload(masks[0]), backend.upload(masks[1])),
        smallest=smallest,
        disparities=count,
        reference=View.LEFT,
        options=_COARSE,
        watch=Stopwatch(),
    )
    values = backend.download(found.values)
    values = values[np.isfinite(values)]
    if len(values) < 0.01 * size[0] * size[1]:
        whole = (0, max(1, left.shape[1] // 4))
        _log.warning("the coarse match found too little to tell the disparity range; searching %s", whole)
        return whole
    histogram = np.bincount(np.floor(values).astype(int) - smallest, minlength=count)
    kept = np.flatnonzero(histogram >= max(3, SMALLEST_SHARE * len(values)))
    if not len(kept):
        kept = np.array([histogram.argmax()])
    found_range = int(kept[-1]) + 1 - int(kept[0])
    first = int(kept[0]) + smallest - MARGIN - FARTHER * found_range
    last = int(kept[-1]) + 1 + smallest + MARGIN + NEARER * found_range
    scale = left.shape[1] / size[0]
    low, high = int(np.floor(first * scale)), int(np.ceil(last * scale))
    return low, high - low
