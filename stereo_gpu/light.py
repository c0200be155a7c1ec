"""Pictures as linear light on the device, (H, W, 4) uint16: red, green, blue, and 65535; 0 where there is no colour.

Only light can be averaged: of a checkerboard of black and white half the light is left, which is level 188, not 128.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.backends import Backend, DeviceArray
from stereo_gpu.types import Bytes

_Light = NDArray[np.uint16]


def decode_light(backend: Backend, picture: DeviceArray, valid: Bytes, scale: float) -> DeviceArray:
    """Light of a picture; where it is not valid, that of valid pixels nearby.

    Args:
        backend: the device that holds it.
        picture: (H, W) or (H, W, 3), uint8 or uint16.
        valid: (H, W) uint8, on the host, 0 where the picture has no content.
        scale: factor that takes its values to sRGB's levels 0..255; what is above becomes 255.
    """
    height, width = picture.shape[:2]
    light = backend.empty((height, width, 4), np.uint16)
    backend.launch(
        "decode",
        picture=picture,
        valid=backend.upload(valid),
        table=backend.upload(_light_of_levels(int(np.iinfo(picture.dtype).max), scale)),
        width=width,
        height=height,
        channels=1 if len(picture.shape) == 2 else picture.shape[2],
        light_out=light,
    )
    if not valid.all():
        fill_gaps(backend, light)
    return light


def encode_light(backend: Backend, light: DeviceArray) -> Bytes:
    """(H, W, 3) uint8: levels of sRGB, on the host."""
    height, width = light.shape[:2]
    picture = backend.empty((height, width, 3), np.uint8)
    table = backend.upload(_levels_of_light())
    backend.launch("encode", light=light, table=table, width=width, height=height, picture_out=picture)
    return np.asarray(backend.download(picture), np.uint8)


def halve_light(backend: Backend, fine: DeviceArray) -> DeviceArray:
    """Means of 2 x 2 pixels, of those that are there; sides are rounded up."""
    height, width = (-(-side // 2) for side in fine.shape[:2])
    coarse = backend.empty((height, width, 4), np.uint16)
    backend.launch(
        "pull",
        fine=fine,
        fine_width=fine.shape[1],
        fine_height=fine.shape[0],
        width=width,
        height=height,
        coarse_out=coarse,
    )
    return coarse


def fill_gaps(backend: Backend, light: DeviceArray) -> None:
    """Give every pixel that is not there a colour from nearby, in place.

    It gets the mean of the smallest square around it, of 2, 4, 8 ... pixels from the picture's corner on, in which
    there is any (Gortler et al., "The Lumigraph", SIGGRAPH 1996, section 3.4.3). These are the squares that a mip map
    averages, so that gaps change none of its levels.
    """
    levels = [light]
    while max(levels[-1].shape[:2]) > 1:
        levels.append(halve_light(backend, levels[-1]))
    for fine, coarse in zip(levels[-2::-1], levels[:0:-1], strict=True):
        height, width = fine.shape[:2]
        backend.launch("push", coarse=coarse, coarse_width=coarse.shape[1], width=width, height=height, fine_out=fine)


@lru_cache(maxsize=4)
def _light_of_levels(largest: int, scale: float) -> _Light:
    """Light, 0..65535, of the levels 0 to `largest` of a picture (IEC 61966-2-1, sRGB)."""
    level = np.minimum(np.arange(largest + 1) * (scale / 255), 1.0)
    light = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)
    return np.asarray(np.floor(65535 * light + 0.5), np.uint16)


@lru_cache(maxsize=1)
def _levels_of_light() -> Bytes:
    """Levels 0..255 of light 0..65535."""
    light = np.arange(65536) / 65535
    level = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.asarray(np.floor(255 * level + 0.5), np.uint8)
