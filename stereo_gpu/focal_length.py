"""The focal length of a pair that has no rig: what the pictures' EXIF says of it, else a guess."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from stereo_gpu.epipolar.uncalibrated import GUESSED_FOCAL
from stereo_gpu.errors import InputError
from stereo_gpu.types import Picture

PLAUSIBLE = 0.3, 20.0  # of the longer side: fields of view of 118 degrees down to 3
SAME = 0.02  # by how much the focal lengths of both pictures may differ
FULL_FRAME_MM = math.hypot(36, 24)
MM_PER_UNIT = {2: 25.4, 3: 10.0, 4: 1.0}  # of EXIF's resolutions: inch, cm, mm
EXIF, EXIF_WIDTH, EXIF_HEIGHT = 0x8769, 0xA002, 0xA003
FOCAL_MM, FOCAL_IN_35_MM, PLANE_X, PLANE_UNIT = 0x920A, 0xA405, 0xA20E, 0xA210


@dataclass(frozen=True)
class FocalLength:
    """A focal length and how it was had.

    Args:
        px: of a picture as it is.
        source: in words.
        guessed: whether nothing but a guess speaks for it.
    """

    px: float
    source: str
    guessed: bool = False


def find_focal_length(
    pictures: Sequence[Picture | str | os.PathLike[str]], size: tuple[int, int], given_px: float | None = None
) -> FocalLength:
    """Take what was given, else what EXIF (CIPA DC-008) says of either picture, else a guess.

    Args:
        pictures: left and right, as arrays, of which nothing is known, or as files.
        size: width and height of both, px.
        given_px: the focal length, if the user knows it.

    Raises:
        InputError: the given one is none, or the pictures were taken with different ones.
    """
    longer = max(size)
    low, high = (limit * longer for limit in PLAUSIBLE)
    if given_px is not None:
        if not low <= given_px <= high:
            raise InputError(
                f"focal length = {given_px:g} px: for pictures of {size[0]} x {size[1]} give {low:.0f} to {high:.0f} px"
            )
        return FocalLength(float(given_px), "given")
    found = [_from_exif(_exif(picture), size) for picture in pictures if not hasattr(picture, "shape")]
    told = [focal for focal in found if focal and low <= focal.px <= high]
    if not told:
        return FocalLength(GUESSED_FOCAL * longer, f"guessed: {GUESSED_FOCAL:g} times the longer side", guessed=True)
    least, most = min(focal.px for focal in told), max(focal.px for focal in told)
    if most > (1 + SAME) * least:
        raise InputError(
            f"the pictures were taken with focal lengths of {least:.0f} and {most:.0f} px, by their EXIF: take both"
            " with the same zoom, or give the focal length"
        )
    return told[0]


def _exif(path: Any) -> dict[int, Any]:
    """The EXIF tags of a file that is there and readable; none where they are missing or broken."""
    from PIL import Image

    try:
        # Pillow warns of pictures above 89 megapixels, which `read_image` takes.
        with (
            warnings.catch_warnings(action="ignore", category=Image.DecompressionBombWarning),
            Image.open(path) as image,
        ):
            return dict(image.getexif().get_ifd(EXIF))
    except Exception:  # whatever a broken EXIF makes Pillow raise: the picture itself may be good
        return {}


def _number(tags: dict[int, Any], tag: int) -> float:
    """A tag as a number above zero; 0 where it is none."""
    try:
        value = float(tags[tag])
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        return 0.0
    return value if math.isfinite(value) and value > 0 else 0.0


def _from_exif(tags: dict[int, Any], size: tuple[int, int]) -> FocalLength | None:
    """From the sensor's resolution, which is exact, else from the focal length that a 35 mm film would need."""
    focal_mm, per_unit = _number(tags, FOCAL_MM), _number(tags, PLANE_X)
    mm = MM_PER_UNIT.get(int(_number(tags, PLANE_UNIT) or 2), 0.0)
    if focal_mm and per_unit and mm:
        # The resolution is that of the picture as it was taken; it may have been shrunk or turned upright since.
        taken = _number(tags, EXIF_WIDTH), _number(tags, EXIF_HEIGHT)
        shrunk = max(size) / max(taken) if all(taken) else size[0] / (taken[0] or size[0])
        px = focal_mm * per_unit / mm * shrunk
        return FocalLength(px, f"EXIF: {focal_mm:g} mm at {per_unit / mm:.1f} px/mm")
    if in_35_mm := _number(tags, FOCAL_IN_35_MM):
        return FocalLength(in_35_mm / FULL_FRAME_MM * math.hypot(*size), f"EXIF: as {in_35_mm:g} mm on 35 mm film")
    return None
