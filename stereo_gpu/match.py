"""Find the disparity of every pixel of the reference view."""

from __future__ import annotations

import logging

import numpy as np

from stereo_gpu.advice import range_warnings
from stereo_gpu.backends import open_backend
from stereo_gpu.disparity_range import find_range
from stereo_gpu.errors import InputError
from stereo_gpu.images import check_pair
from stereo_gpu.match_options import Range, Window, check_range, choose_options, parse_profile, parse_view
from stereo_gpu.prepare import find_levels
from stereo_gpu.tiles import match_in_tiles
from stereo_gpu.timing import Stopwatch
from stereo_gpu.types import Bytes, Disparity, Picture, View

_log = logging.getLogger(__name__)


def match(
    left: Picture,
    right: Picture,
    *,
    disparities: Range = "auto",
    window: Window | None = None,
    reference: str = "right",
    profile: str = "fast",
    mask: Bytes | None = None,
    other_mask: Bytes | None = None,
    tile: int | None = None,
    backend: str | None = None,
) -> Disparity:
    """Match a rectified pair: by normalized cross-correlation, or in profile "precise" along smooth paths.

    Args:
        left, right: rectified pictures of one size, (H, W) or (H, W, 3), uint8 or uint16.
        disparities: smallest disparity and how many to search, px; "auto" finds them first.
        window: side of the correlation window, px, odd, 3 to 31; None takes the profile's; "auto" in profile "fast"
            takes at each pixel the smallest of several that the other view and the surroundings confirm.
        reference: the view that the map is laid out on, "right" as in the paper, or "left".
        profile: "paper" (the paper's appendix and median filter), "fast" or "precise".
        mask: (H, W), 0 where the reference view is not to be matched.
        other_mask: (H, W), 0 where the other view has no content.
        tile: largest side of the parts that are matched one after another, px; None takes what fits the memory.
        backend: where to compute; None takes STEREO_GPU_BACKEND, else the best device.

    Returns:
        The map, with the range that was searched. A range that cuts the scene off is told in the log.
        In profile "paper" `numpy.nan_to_num(values)` is the paper's own map, 0 where nothing correlates.

    Raises:
        InputError: a picture, mask or option is wrong.
        MemoryLimitError: not even the smallest tile fits the device.

    Source: Medina-Zegarra and Lobaton, "3-D Visual Reconstruction: A System Perspective", appendix.
    """
    check_pair(left, right)
    view, chosen = parse_view(reference), parse_profile(profile)
    options = choose_options(chosen, window, tile)
    device = open_backend(backend)
    masks = [_mask(m, left.shape[:2], name) for m, name in ((mask, "mask"), (other_mask, "other_mask"))]
    if disparities == "auto":
        valid_left, valid_right = masks if view is View.LEFT else masks[::-1]
        disparities = find_range(device, left, right, valid_left, valid_right)
    smallest, count = check_range(disparities, left.shape[1])
    found = match_in_tiles(
        device,
        left,
        right,
        levels=(find_levels(left), find_levels(right)),
        masks=(masks[0], masks[1]),
        smallest=smallest,
        disparities=count,
        reference=view,
        profile=chosen,
        options=options,
        watch=Stopwatch(),
    )
    for told in range_warnings(found):
        _log.warning(told)
    return found


def _mask(mask: Bytes | None, shape: tuple[int, ...], name: str) -> Bytes:
    if mask is None:
        return np.ones(shape, np.uint8)
    if mask.shape != shape:
        raise InputError(
            f"{name} is {mask.shape[::-1]}, the pictures are {shape[::-1]}: give one value a pixel, 0 to leave out"
        )
    return np.asarray(mask != 0, np.uint8)
