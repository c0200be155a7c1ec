"""Make a picture ready for the correlation: grey, smoothed if asked, with the sums of its windows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from stereo_gpu.backends import Backend, DeviceArray
from stereo_gpu.config import MatchOptions
from stereo_gpu.types import Picture

# Of a picture's bright end: less is flat, and is not stretched until its noise looks like texture.
LEAST_CONTRAST = 1 / 16
# Mean and standard deviation of a guide's planes.
GUIDE_MEAN, GUIDE_DEVIATION = 128.0, 50.0
COLOURED = 0.02  # share of their values by which the channels of a picture in colour differ
LEAST_DEVIATION = 1e-3  # in a picture's values; less is how sums are rounded
# A picture's mean and deviation are taken of about so many pixels.
ENOUGH_PIXELS = 1 << 20


class GreyLevels(NamedTuple):
    """Which of a picture's values become grey levels 0..255: the value of 0, and levels a value."""

    black: float = 0.0
    scale: float = 1.0


class Levels(NamedTuple):
    """How a picture's values are matched: as grey levels, and as colours of known mean and contrast.

    `colours` are a gain and an offset for each of three channels, as `colour_levels` gives them; `coloured` tells
    whether the channels differ. `noise` is the variance of the grey levels' noise where it is known, else 0.
    """

    grey: GreyLevels = GreyLevels()
    colours: tuple[float, ...] = (1.0, 0.0) * 3
    coloured: bool = False
    noise: float = 0.0

    @property
    def flat(self) -> bool:
        """Whether the picture is of one colour."""
        return not any(self.colours[::2])


@dataclass(frozen=True, kw_only=True)
class DeviceView:
    """One grey view on the device, with what the correlation needs to know of each of its windows."""

    grey: DeviceArray
    window_sum: DeviceArray
    inverse_norm: DeviceArray
    validity: DeviceArray


def make_grey(backend: Backend, picture: DeviceArray, levels: GreyLevels, options: MatchOptions) -> DeviceArray:
    """Centred grey levels of a picture, (H, W) float32, smoothed if asked."""
    height, width = picture.shape[:2]
    grey = backend.empty((height, width), np.float32)
    channels = 1 if len(picture.shape) == 2 else 3
    backend.launch(
        "grey",
        picture=picture,
        width=width,
        height=height,
        channels=channels,
        black=levels.black,
        scale=levels.scale,
        grey_out=grey,
    )
    return _smooth(backend, grey, options.smooth_sigma) if options.smooth_sigma > 0 else grey


def sum_windows(backend: Backend, grey: DeviceArray, mask: DeviceArray, options: MatchOptions) -> DeviceView:
    """Sum up each window of grey levels, and tell the flat ones."""
    height, width = grey.shape
    window_sum, inverse = (backend.empty((height, width), np.float32) for _ in range(2))
    validity = backend.empty((height, width), np.uint8)
    backend.launch(
        "window_norms",
        picture=grey,
        mask=mask,
        width=width,
        height=height,
        radius=options.window // 2,
        # The norm of a window is its RMS contrast times the square root of its number of pixels.
        threshold=options.texture_threshold * options.window,
        sum_out=window_sum,
        inverse_out=inverse,
        validity_out=validity,
    )
    return DeviceView(grey=grey, window_sum=window_sum, inverse_norm=inverse, validity=validity)


def find_levels(picture: Picture) -> Levels:
    """What brings a whole picture to the levels that are matched."""
    return Levels(grey_levels(picture), colour_levels(picture), _is_coloured(picture))


def _is_coloured(picture: Picture) -> bool:
    """Whether the channels differ by more than a camera's noise, on average."""
    if picture.ndim == 2:
        return False
    some = picture[:: max(1, picture.shape[0] // 64)].astype(np.float32)
    apart = np.abs(some[..., 0] - some[..., 1]).mean() + np.abs(some[..., 2] - some[..., 1]).mean()
    return bool(apart > COLOURED * some.mean())


def grey_levels(picture: Picture) -> GreyLevels:
    """Values of a picture that are matched as black and white; of uint8 0 and 255.

    A uint16 picture's dark and bright end, so that neither its exposure nor its black level changes what is matched.
    """
    if picture.dtype == np.uint8:
        return GreyLevels()
    # Few cameras fill 16 bits; a handful of hot pixels must not darken the rest. Whole rows, so that a mirrored
    # picture gives the same.
    dark, bright = (float(value) for value in np.percentile(picture[::4], (0.1, 99.9)))
    span = max(1.0, bright - dark, bright * LEAST_CONTRAST)
    return GreyLevels(dark, 255.0 / span)


def colour_levels(picture: Picture) -> tuple[float, ...]:
    """Gain and offset that take each of three channels to the mean and deviation of a guide.

    So neither gain nor offset of a camera changes the guide. A channel of one value has gain 0; a grey picture has the
    same numbers three times.
    """
    # Whole rows, so that a mirrored picture gives the same.
    step = max(1, picture.shape[0] * picture.shape[1] // ENOUGH_PIXELS)
    means, deviations = cv2.meanStdDev(np.ascontiguousarray(picture[::step]))
    levels: list[float] = []
    for mean, deviation in zip(means.ravel(), deviations.ravel(), strict=True):
        gain = GUIDE_DEVIATION / float(deviation) if deviation > LEAST_DEVIATION else 0.0
        levels += [gain, GUIDE_MEAN - float(mean) * gain]
    return tuple(levels if len(levels) == 6 else levels * 3)


def make_guide(backend: Backend, picture: DeviceArray, levels: Sequence[float]) -> DeviceArray:
    """Colours of a picture in the levels that `colour_levels` gives, (3, H, W) uint8."""
    height, width = picture.shape[:2]
    guide = backend.empty((3, height, width), np.uint8)
    backend.launch(
        "guide",
        picture=picture,
        levels=backend.upload(np.array(levels, np.float32)),
        width=width,
        height=height,
        channels=1 if len(picture.shape) == 2 else 3,
        guide_out=guide,
    )
    return guide


def grey_scale(picture: Picture) -> float:
    """Factor that takes a picture's values to 0..255: 1 for uint8; a uint16 picture's bright end becomes 255."""
    if picture.dtype == np.uint8:
        return 1.0
    # Few cameras fill 16 bits; a handful of hot pixels must not darken the rest. Whole rows, so that a mirrored
    # picture gives the same.
    return 255.0 / max(1.0, float(np.percentile(picture[::4], 99.9)))


def _smooth(backend: Backend, grey: DeviceArray, sigma: float) -> DeviceArray:
    radius = max(1, math.ceil(3 * sigma))
    offsets = np.arange(-radius, radius + 1)
    weights = np.exp(-0.5 * (offsets / sigma) ** 2)
    held = backend.upload((weights / weights.sum()).astype(np.float32))
    height, width = grey.shape
    for axis in (0, 1):
        smoothed = backend.empty(grey.shape, np.float32)
        backend.launch(
            "smooth",
            source=grey,
            weights=held,
            width=width,
            height=height,
            radius=radius,
            axis=axis,
            smoothed_out=smoothed,
        )
        grey = smoothed
    return grey
