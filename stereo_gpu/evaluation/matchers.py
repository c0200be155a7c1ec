"""What is held against the truth and the clock: our profiles, and OpenCV's matchers as their samples call them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import cv2
import numpy as np

from stereo_gpu.config import PROFILES, Profile
from stereo_gpu.images import grey
from stereo_gpu.match import match
from stereo_gpu.match_options import Range
from stereo_gpu.types import Bytes, Floats, Picture

Search = tuple[int, int]
Masks = tuple[Bytes | None, Bytes | None]
YARDSTICK = "SGBM HH 5x5"  # whose time is 1; the benchmark's SGBM HH
PRECISE, FAST = "`precise`", "`fast`"
AUTO = "`precise`, range found"
STEP = 16  # OpenCV takes a multiple of it as the number of disparities


@dataclass(frozen=True, kw_only=True)
class Found:
    """A map on the left view.

    Args:
        values: (H, W) float32, px; NaN where there is none.
        search: the range that was searched, smallest disparity and how many.
        confidence: (H, W) float32; None from OpenCV, which tells none.
    """

    values: Floats
    search: Search
    confidence: Floats | None = None


class Find(Protocol):
    """How a matcher makes a map."""

    def __call__(self, left: Picture, right: Picture, search: Search, masks: Masks = (None, None)) -> Found:
        """Match a rectified pair over a range; masks are 0 where the left or right picture has no content."""


@dataclass(frozen=True)
class Matcher:
    """A way to match.

    Args:
        name: short, for tables.
        find: makes the map of a rectified pair over a range.
        prepare: readies what is timed: one call makes one map.
        ours: whether it is a profile of this project.
    """

    name: str
    find: Find
    prepare: Callable[[Picture, Picture, Search], Callable[[], object]]
    ours: bool = False


def our_matchers(backend: str | None) -> list[Matcher]:
    """The profiles, and `precise` where it has to find the range itself, on a device.

    What is timed is the whole call, arrays of the host in and out.
    """
    return [*(_profile(str(profile), backend) for profile in PROFILES), _finder(backend)]


def opencv_matchers() -> list[Matcher]:
    """OpenCV's block matcher and its semi-global ones.

    Windows, and penalties of 8 and 32 for each of a window's pixels, are those of OpenCV's sample stereo_match.py, and
    so are the filters of the one that is called filtered. They get grey pictures, on which they do better than in
    colour. What is timed is `compute` alone.
    """
    three, eight = cv2.StereoSGBM_MODE_SGBM_3WAY, cv2.StereoSGBM_MODE_HH
    return [
        _opencv("StereoBM 15x15", partial(_block, window=15)),
        _opencv("SGBM 3WAY 5x5", partial(_semi_global, window=5, mode=three)),
        _opencv("SGBM HH 3x3", partial(_semi_global, window=3, mode=eight)),
        _opencv(YARDSTICK, partial(_semi_global, window=5, mode=eight)),
        _opencv("SGBM HH 5x5 filtered", partial(_semi_global, window=5, mode=eight, filtered=True)),
    ]


def _ours(
    profile: str, backend: str | None, left: Picture, right: Picture, search: Range, masks: Masks = (None, None)
) -> Found:
    found = match(
        left,
        right,
        disparities=search,
        reference="left",
        profile=profile,
        mask=masks[0],
        other_mask=masks[1],
        backend=backend,
    )
    return Found(values=found.values, search=(found.smallest, found.disparities), confidence=found.confidence)


def _profile(profile: str, backend: str | None) -> Matcher:
    find = partial(_ours, profile, backend)
    return Matcher(f"`{profile}`", find, lambda *pair: lambda: find(*pair), ours=True)


def _finder(backend: str | None) -> Matcher:
    find = partial(_ours, Profile.PRECISE, backend)

    def anywhere(left: Picture, right: Picture, search: Search, masks: Masks = (None, None)) -> Found:
        return find(left, right, "auto", masks)

    return Matcher(AUTO, anywhere, lambda *pair: lambda: anywhere(*pair), ours=True)


def _block(smallest: int, count: int, window: int) -> cv2.StereoMatcher:
    matcher = cv2.StereoBM.create(count, window)
    matcher.setMinDisparity(smallest)
    return matcher


def _semi_global(smallest: int, count: int, window: int, mode: int, filtered: bool = False) -> cv2.StereoMatcher:
    filters = {"disp12MaxDiff": 1, "uniquenessRatio": 10, "speckleWindowSize": 100, "speckleRange": 32}
    return cv2.StereoSGBM.create(
        minDisparity=smallest,
        numDisparities=count,
        blockSize=window,
        P1=8 * window * window,
        P2=32 * window * window,
        mode=mode,
        **(filters if filtered else {}),
    )


def _opencv(name: str, make: Callable[[int, int], cv2.StereoMatcher]) -> Matcher:
    def find(left: Picture, right: Picture, search: Search, masks: Masks = (None, None)) -> Found:
        smallest, count = _whole_steps(search)
        # OpenCV gives no value to a column whose partners may lie outside of the other picture. Both pictures are
        # widened by as much, so that its map is as wide as ours.
        before, after = max(0, smallest + count), max(0, -smallest)
        wide = [cv2.copyMakeBorder(grey(p), 0, 0, before, after, cv2.BORDER_REPLICATE) for p in (left, right)]
        raw = make(smallest, count).compute(*wide)[:, before : before + left.shape[1]]
        values = raw.astype(np.float32) / np.float32(cv2.StereoMatcher_DISP_SCALE)
        return Found(values=np.where(values < smallest, np.float32(np.nan), values), search=(smallest, count))

    def prepare(left: Picture, right: Picture, search: Search) -> Callable[[], object]:
        matcher, flat = make(*_whole_steps(search)), [grey(picture) for picture in (left, right)]
        return lambda: matcher.compute(*flat)

    return Matcher(name, find, prepare)


def _whole_steps(search: Search) -> Search:
    smallest, count = search
    return smallest, -(-count // STEP) * STEP
