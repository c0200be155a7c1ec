"""Find which disparities a pair has, so that nobody needs to know them: coarse matches over nearly all of them."""

from __future__ import annotations

import dataclasses
import logging
import math

import cv2
import numpy as np

from stereo_gpu.backends import Backend
from stereo_gpu.config import PROFILES, MatchOptions, Profile
from stereo_gpu.device_match import match_on
from stereo_gpu.match_options import LARGEST_RANGE
from stereo_gpu.prepare import grey_scale
from stereo_gpu.timing import Stopwatch
from stereo_gpu.types import Bytes, Floats, Picture, View

_log = logging.getLogger(__name__)

COARSE_WIDTH = 320  # px; small enough to search everything, large enough for a window to hold texture
COARSE_PIXELS = COARSE_WIDTH * 1000
SMALLEST_SHARE = 0.001  # of the matched pixels: fewer at one coarse disparity are taken for false matches
MARGIN = 2  # coarse px on either side, for what the coarse picture could not resolve
# Shares of the found range that are added. Near surfaces are the ones that a coarse match loses: they are cut off
# by the picture's edge, thin, or seen at a slant.
FARTHER, NEARER = 0.05, 0.15
# Smooth paths tell surfaces from false matches; windows alone find what is too thin for a smooth path.
_SMOOTH = dataclasses.replace(PROFILES[Profile.PRECISE], row_slopes=(0,), slant_rounds=0, fill_reach=0)
_THIN = dataclasses.replace(PROFILES[Profile.FAST], fill_reach=0)


def find_range(
    backend: Backend,
    left: Picture,
    right: Picture,
    valid_left: Bytes,
    valid_right: Bytes,
    *,
    infinity_px: float | None = None,
) -> tuple[int, int]:
    """Find the disparity range of a rectified pair.

    Args:
        backend: where to compute.
        left, right: rectified pictures of one size.
        valid_left, valid_right: (H, W), 0 where a picture has no content.
        infinity_px: disparity of a point at infinity, under which nothing can be; None where it is not known.

    Returns:
        Smallest disparity and how many, px. Searched are a quarter of the width below 0 and three quarters above.
    """
    # By width, or by area where a tall strip would make a large volume all the same.
    factor = max(
        1, -(-left.shape[1] // COARSE_WIDTH), math.ceil(math.sqrt(left.shape[0] * left.shape[1] / COARSE_PIXELS))
    )
    size = (max(1, left.shape[1] // factor), max(1, left.shape[0] // factor))
    pictures = [cv2.resize(picture, size, interpolation=cv2.INTER_AREA) for picture in (left, right)]
    masks = [cv2.resize(mask, size, interpolation=cv2.INTER_NEAREST) for mask in (valid_left, valid_right)]
    scale = left.shape[1] / size[0]
    smallest, end = -(size[0] // 4), size[0] - size[0] // 4
    if infinity_px is not None:
        smallest = max(smallest, math.floor(infinity_px / scale))
    count = max(1, end - smallest)
    smooth = _coarse(backend, pictures, masks, smallest, count, _SMOOTH)
    if len(smooth) < 0.01 * size[0] * size[1]:
        whole = (math.floor(smallest * scale), math.ceil(count * scale))
        _log.warning("the coarse match found too little to tell the disparity range; searching all of %s", whole)
        return _limited(*whole)
    low, high = _ends(smooth, smallest, count)
    thin = _coarse(backend, pictures, masks, smallest, count, _THIN)
    if len(thin):
        high = max(high, _ends(thin, smallest, count)[1])
    first = (low - MARGIN - FARTHER * (high - low)) * scale
    last = (high + MARGIN + NEARER * (high - low)) * scale
    if infinity_px is not None:
        first = max(first, infinity_px)
    return _limited(math.floor(first), max(1, math.ceil(last) - math.floor(first)))


def _limited(smallest: int, count: int) -> tuple[int, int]:
    """The middle of a range that is longer than can be searched."""
    if count <= LARGEST_RANGE:
        return smallest, count
    kept = smallest + (count - LARGEST_RANGE) // 2, LARGEST_RANGE
    _log.warning(
        "disparities from %d on, %d of them, are more than can be searched; searching %s", smallest, count, kept
    )
    return kept


def _coarse(
    backend: Backend, pictures: list[Picture], masks: list[Bytes], smallest: int, count: int, options: MatchOptions
) -> Floats:
    """Disparities that a coarse match is sure of, as a list."""
    found = match_on(
        backend,
        backend.upload(pictures[0]),
        backend.upload(pictures[1]),
        scales=(grey_scale(pictures[0]), grey_scale(pictures[1])),
        masks=(backend.upload(masks[0]), backend.upload(masks[1])),
        smallest=smallest,
        disparities=count,
        reference=View.LEFT,
        options=options,
        watch=Stopwatch(),
    )
    values: Floats = backend.download(found.values)
    return values[np.isfinite(values)]


def _ends(values: Floats, smallest: int, count: int) -> tuple[int, int]:
    """First and last whole disparity, exclusive, that enough values have."""
    indices = np.clip(np.floor(values).astype(int) - smallest, 0, count - 1)
    histogram = np.bincount(indices, minlength=count)
    kept = np.flatnonzero(histogram >= max(3, SMALLEST_SHARE * len(values)))
    if not len(kept):
        kept = np.array([histogram.argmax()])
    return int(kept[0]) + smallest, int(kept[-1]) + 1 + smallest
