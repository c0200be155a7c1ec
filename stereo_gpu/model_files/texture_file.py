"""Pack a texture as PNG, JPEG or WebP."""

from __future__ import annotations

import io
from typing import Any

import cv2
import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.types import Bytes

# The largest side that each format can hold, px.
TEXTURE_FORMATS = {"png": 1_000_000, "jpeg": 65_500, "webp": 16_383}
DEFAULT_QUALITY = 95


def pack_texture(texture: Bytes, form: str = "png", quality: int | None = None) -> bytes:
    """The bytes of a picture file.

    Args:
        texture: (S, T, 3) uint8 RGB.
        form: png, without loss; jpeg, with colours as fine as brightness; or webp, the smallest.
        quality: of JPEG and WebP, 1 to 100; None for 95. A WebP of quality 100 is without loss.

    Raises:
        InputError: the format or the quality is unknown, or the texture is too large for it.
    """
    check_texture_format(form, quality)
    height, width = texture.shape[:2]
    if max(width, height) > TEXTURE_FORMATS[form]:
        raise InputError(
            f"a texture of {width} x {height} px is too large for {form}, which ends at {TEXTURE_FORMATS[form]} px"
            " a side: choose png"
        )
    quality = DEFAULT_QUALITY if quality is None else quality
    if form == "webp":
        return _webp(texture, quality)
    _, data = cv2.imencode(f".{form}", cv2.cvtColor(texture, cv2.COLOR_RGB2BGR), _settings(form, quality))
    return data.tobytes()


def check_texture_format(form: str, quality: int | None = None) -> None:
    """Refuse a texture's format before any work is done.

    Raises:
        InputError: the format or the quality is unknown.
    """
    if form not in TEXTURE_FORMATS:
        raise InputError(f"texture format {form!r:.40} is unknown: choose {', '.join(TEXTURE_FORMATS)}")
    if quality is not None and form == "png":
        raise InputError(f"quality {quality!r:.20} of a PNG: it is without loss; leave it out, or choose jpeg or webp")
    if quality is not None and (isinstance(quality, bool) or not isinstance(quality, int) or not 1 <= quality <= 100):
        raise InputError(f"quality {quality!r:.20} of a texture: give a whole number from 1 to 100")


def _settings(form: str, quality: int) -> list[int]:
    if form == "jpeg":
        # Not 4:2:0: at one size of file, colours in full are 1.4 dB nearer to a photo than halved ones in finer steps.
        return [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, 0x111111]
    # Photos hardly repeat themselves, so that the search for repeats takes its time for nothing: runs of one value
    # after Paeth's prediction take half of level 3's time and 7 % less room.
    settings = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
    if hasattr(cv2, "IMWRITE_PNG_FILTER"):  # OpenCV 4.10 has no choice
        settings += [cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_PAETH]
    return settings


def _webp(texture: Bytes, quality: int) -> bytes:
    # Through Pillow, since OpenCV's only effort takes three times as long for 6 % less room.
    from PIL import Image

    how: dict[str, Any] = {"lossless": True, "quality": 0} if quality == 100 else {"quality": quality}
    packed = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(texture)).save(packed, "WEBP", method=0, **how)
    return packed.getvalue()
