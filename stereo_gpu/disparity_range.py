"""Find which disparities a pair has, so that nobody needs to know them: a coarse pass, then a finer one."""

from __future__ import annotations

import logging
import math

import cv2
import numpy as np

from stereo_gpu.backends import Backend
from stereo_gpu.images import grey
from stereo_gpu.match_options import LARGEST_RANGE
from stereo_gpu.range_ends import find_ends
from stereo_gpu.range_matches import find_surfaces
from stereo_gpu.sparse_matches import match_sparse
from stereo_gpu.types import Bytes, Picture

_log = logging.getLogger(__name__)

COARSE_PIXELS = 320 * 240  # small enough to search everything
FINE_PIXELS = 640 * 480
WIDEST = 2000  # px, of a shrunk strip: what is searched in it stays under LARGEST_RANGE
REACH = 0.9  # of the width, to either side: what is nearer overlaps too little to be told from chance
LOOK = 0.25  # of the coarse range, by which the finer pass looks farther on either side
LOOK_PX = 4  # coarse px, the least of that
# Shares of the found range that are added to it. Near surfaces are the ones that a match loses: they are cut off by
# the picture's edge, thin, or seen at a slant.
FARTHER, NEARER = 0.05, 0.15


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
        Smallest disparity and how many, px. Searched are 0.9 widths to either side of 0.
    """
    pictures, masks = [grey(picture) for picture in (left, right)], [valid_left, valid_right]
    coarse, coarse_masks, scale = _shrink(pictures, masks, COARSE_PIXELS)
    ends = _coarse_ends(backend, coarse, coarse_masks, None if infinity_px is None else infinity_px / scale)
    if ends is None:
        first = -left.shape[1] // 4 if infinity_px is None else math.floor(max(infinity_px, -left.shape[1] // 4))
        count = max(1, left.shape[1] * 3 // 4 - first)
        _log.warning(
            "too little of the pictures matches to tell the disparity range; searching %d to %d",
            first,
            first + count - 1,
        )
        return _limited(first, count)
    low, high = ends[0] * scale, ends[1] * scale
    margin = scale
    fine, fine_masks, fine_scale = _shrink(pictures, masks, FINE_PIXELS)
    if fine_scale < scale:
        look = max(LOOK * (high - low), LOOK_PX * scale)
        bottom = low - look if infinity_px is None else max(low - look, infinity_px)
        smallest = math.floor(bottom / fine_scale)
        count = min(LARGEST_RANGE // 2, math.ceil((high + look) / fine_scale) - smallest + 1)
        better = find_ends(find_surfaces(backend, fine, fine_masks, smallest, count))
        if better is not None:
            # The coarse pass may have seen what is blurred or has little texture, to a pixel of its own.
            low, high = min(low + scale, better[0] * fine_scale), max(high - scale, better[1] * fine_scale)
            margin = fine_scale
    span = high - low
    first = math.floor(_bounded(low - margin - FARTHER * span, infinity_px))
    return _limited(first, max(1, math.ceil(high + margin + NEARER * span) - first + 1))


def _coarse_ends(
    backend: Backend, pictures: list[Bytes], masks: list[Bytes], infinity_px: float | None
) -> tuple[float, float] | None:
    """Ends of the disparities over all that can be, in px of these pictures; of features where no surface is found."""
    reach = int(REACH * pictures[0].shape[1])
    smallest = math.floor(_bounded(-reach, infinity_px))
    ends = find_ends(find_surfaces(backend, pictures, masks, smallest, max(1, reach - smallest)))
    if ends is not None:
        return ends
    # On mostly blank pictures, such as marks on a wall, what has a disparity is too small to be a surface.
    sparse = match_sparse(pictures, masks, smallest, reach - smallest)
    return (float(sparse.min()), float(sparse.max())) if len(sparse) else None


def _shrink(pictures: list[Bytes], masks: list[Bytes], pixels: int) -> tuple[list[Bytes], list[Bytes], float]:
    """Pictures and masks of so many pixels at the most, and the factor by which they are narrower."""
    height, width = pictures[0].shape
    factor = max(1.0, math.sqrt(height * width / pixels), width / WIDEST)
    if factor == 1:
        return pictures, masks, 1.0
    size = (max(1, round(width / factor)), max(1, round(height / factor)))
    shrunk = [np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8) for picture in pictures]
    without = [np.asarray(cv2.resize(mask, size, interpolation=cv2.INTER_NEAREST), np.uint8) for mask in masks]
    return shrunk, without, width / size[0]


def _bounded(end: float, infinity_px: float | None) -> float:
    return end if infinity_px is None else max(end, infinity_px)


def _limited(smallest: int, count: int) -> tuple[int, int]:
    """The middle of a range that is longer than can be searched."""
    if count <= LARGEST_RANGE:
        return smallest, count
    kept = smallest + (count - LARGEST_RANGE) // 2, LARGEST_RANGE
    _log.warning(
        "disparities from %d on, %d of them, are more than can be searched; searching %s", smallest, count, kept
    )
    return kept
