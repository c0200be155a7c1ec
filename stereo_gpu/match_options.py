"""Refuse options of a match that no kernel can take, and turn their names into what they stand for."""

from __future__ import annotations

import dataclasses
import logging
from typing import Literal

from stereo_gpu.config import AUTO_SHARE, AUTO_WINDOWS, PROFILES, MatchOptions, Profile
from stereo_gpu.errors import InputError
from stereo_gpu.types import View

_log = logging.getLogger(__name__)

LARGEST_RANGE = 8192  # winner_key holds a disparity's index in at most 13 bits
SMALLEST_TILE = 16  # px; a smaller one is all margin
STEEPEST_SLOPE = 3  # px a row; the walls of aggregate_cpu are as thick
Range = tuple[int, int] | Literal["auto"]
Window = int | Literal["auto"]


def check_range(disparities: tuple[int, int], width: int) -> tuple[int, int]:
    """Refuse a disparity range that is empty, too long or outside of the picture.

    Raises:
        InputError: with the range and the picture's width.
    """
    try:
        smallest, count = (int(number) for number in disparities)
    except (TypeError, ValueError) as error:
        raise InputError(f'disparities = {disparities!r}: give (smallest, how many) or "auto"') from error
    if count < 1:
        raise InputError(f"disparities = ({smallest}, {count}) is an empty range: search at least 1, or use auto")
    if count > LARGEST_RANGE:
        raise InputError(f"disparities = ({smallest}, {count}): at most {LARGEST_RANGE} can be searched; use auto")
    if smallest >= width or smallest + count <= -width:
        raise InputError(
            f"disparities = ({smallest}, {count}) lies outside of a picture {width} px wide: use auto or a range within"
        )
    return smallest, count


def choose_options(profile: Profile, window: Window | None = None, tile: int | None = None) -> MatchOptions:
    """A profile's options, with the window and tile that were asked for.

    Args:
        profile: whose options.
        window: side of the window, px; None takes the profile's. "auto" leaves the choice to each pixel: `fast` then
            tries AUTO_WINDOWS. `precise` needs no window, and says so in the log if one is given.
        tile: largest side of a tile, px; None for what fits the memory.

    Raises:
        InputError: no kernel can take such a window, the profile has one by definition, or the tile is too small.
    """
    # NumPy's numbers, too, are to be written to result.json.
    options = dataclasses.replace(PROFILES[profile], tile=None if tile is None else int(tile))
    if isinstance(window, str):
        if window != "auto":
            raise InputError(f"window = {window!r}: give the side of a square in px, odd, 3 to 31, or auto")
        if profile is Profile.PAPER:
            raise InputError("window = auto: profile paper has one window for all pixels; give its side, or use fast")
        if profile is Profile.FAST:
            options = dataclasses.replace(
                options, window=AUTO_WINDOWS[-1], windows=AUTO_WINDOWS, windows_share=AUTO_SHARE
            )
    elif window is not None and options.smooth_paths:
        check_options(dataclasses.replace(options, window=int(window)))
        _log.warning("window = %d is not used: profile precise finds what belongs to a pixel by itself", window)
    elif window is not None:
        options = dataclasses.replace(options, window=int(window))
    check_options(options)
    return options


def check_options(options: MatchOptions) -> None:
    """Refuse a window, slope or tile that no kernel can take.

    Raises:
        InputError: with the value.
    """
    for window in (options.window, *options.windows):
        if window % 2 == 0 or not 3 <= window <= 31:
            raise InputError(f"window = {window}: it must be odd and from 3 to 31, or auto")
    if any(abs(slope) > STEEPEST_SLOPE for slope in options.row_slopes):
        raise InputError(f"row_slopes = {options.row_slopes}: at most {STEEPEST_SLOPE} px a row can be followed")
    if options.tile is not None and options.tile < SMALLEST_TILE:
        raise InputError(f"tile = {options.tile}: it must be {SMALLEST_TILE} px or more, or be left out")


def parse_view(name: str) -> View:
    """Turn "left" or "right" into a View; InputError for anything else."""
    if name not in list(View):
        raise InputError(f"reference = {name!r}: it must be left or right")
    return View(name)


def parse_profile(name: str) -> Profile:
    """Turn a profile's name into a Profile; InputError for anything else."""
    if name not in list(Profile):
        raise InputError(f"profile = {name!r}: it must be one of {', '.join(Profile)}")
    return Profile(name)
