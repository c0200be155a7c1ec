"""Match two rectified pictures that are on a device; the map stays there until it is downloaded."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from stereo_gpu import smooth_paths, winners
from stereo_gpu.backends import Backend, DeviceArray
from stereo_gpu.config import MatchOptions, Profile
from stereo_gpu.prepare import Levels
from stereo_gpu.smooth_paths import match_paths
from stereo_gpu.timing import Stopwatch
from stereo_gpu.types import Bytes, Disparity, Floats, Validity, View
from stereo_gpu.windows import match_windows
from stereo_gpu.winners import Winners

# A map of smooth paths is believed if this share of its pixels has a confidence over that.
SURE_SHARE, SURE = 0.04, 0.9
# How likely a disparity of smooth paths is wrong by more than 1 px if another is as good.
DOUBT = 0.4


def match_on(
    backend: Backend,
    left: DeviceArray,
    right: DeviceArray,
    *,
    levels: tuple[Levels, Levels],
    masks: tuple[DeviceArray, DeviceArray],
    smallest: int,
    disparities: int,
    reference: View,
    options: MatchOptions,
    watch: Stopwatch,
) -> Winners:
    """Match pictures that are on the device; the map stays there.

    Args:
        backend: the device.
        left, right: pictures on it.
        levels: of the left and right picture's values.
        masks: of the reference view and of the other one, on the device.
        smallest, disparities: the range to search.
        reference: the view that the map is laid out on.
        options: of the matching.
        watch: collects seconds a step.

    Raises:
        MemoryLimitError: the job does not fit the device.
    """
    check_match_memory(backend, left.shape[1], left.shape[0], disparities, options)
    search = {"smallest": smallest, "disparities": disparities, "direction": 1 if reference is View.RIGHT else -1}
    views = (left, levels[0]), (right, levels[1])
    (ours, our_levels), (theirs, their_levels) = views if reference is View.LEFT else views[::-1]
    way = match_paths if options.smooth_paths else match_windows
    return way(backend, (ours, theirs), (our_levels, their_levels), masks, search, options, watch)


def count_sure(disparity: Disparity, part: tuple[slice, slice]) -> tuple[int, int]:
    """How many pixels of a part have a value that is likely right, and how many have a value."""
    confidence = disparity.confidence[part][np.isfinite(disparity.values[part])]
    return int((confidence > SURE).sum()), confidence.size


def is_founded(sure: int, given: int) -> bool:
    """Whether a map of smooth paths shows a surface, judged over all of it.

    Paths carry disparities across flat parts; between two pictures without texture they would carry noise.
    """
    return sure >= SURE_SHARE * given


def drop_all(values: Floats, validity: Bytes) -> None:
    """Take every value of a map away, in place."""
    values[...] = np.nan
    masked = (validity & Validity.MASKED) != 0
    validity[...] = Validity.TEXTURELESS
    validity[masked] = Validity.MASKED


def download_disparity(
    backend: Backend,
    found: Winners,
    smallest: int,
    disparities: int,
    reference: View,
    profile: Profile,
    options: MatchOptions,
    watch: Stopwatch,
) -> Disparity:
    """Copy a map back, with how far each value is to be trusted: the less, the closer the runner-up comes."""
    height, width = found.values.shape
    confidence = backend.empty((height, width), np.float32)
    known: dict[str, Any] = {"ratio": found.ratio, "validity": found.validity, "width": width, "height": height}
    if options.smooth_paths:
        backend.launch("certainty", **known, doubt=DOUBT, confidence_out=confidence)
    else:
        backend.launch("confidence", **known, score=found.score, weight=1.0, confidence_out=confidence)
    values, validity = backend.download(found.values), backend.download(found.validity)
    # Planes through flat parts go on where nothing is wanted.
    values = np.where(validity & Validity.MASKED, np.float32(np.nan), values)
    return Disparity(
        values=values,
        validity=validity,
        confidence=backend.download(confidence),
        reference=reference,
        smallest=smallest,
        disparities=disparities,
        backend=backend.name,
        device=backend.device,
        options={"profile": str(profile), **dataclasses.asdict(options)},
        seconds=dict(watch.seconds),
    )


def check_match_memory(backend: Backend, width: int, height: int, disparities: int, options: MatchOptions) -> None:
    """Estimate what a match takes and refuse it if it cannot fit.

    Raises:
        MemoryLimitError: with needed and available bytes and the option that would make it fit.
    """
    remedy = "use smaller pictures or fewer disparities"
    if options.smooth_paths or options.whole_volume:
        remedy = "use profile fast, which never holds a cost volume, or fewer disparities"
    backend.check_memory(*match_bytes(backend, width, height, disparities, options), remedy)


def match_bytes(backend: Backend, width: int, height: int, disparities: int, options: MatchOptions) -> tuple[int, int]:
    """Estimate what a match takes on a device: bytes in all, and of the largest array."""
    # Two pictures, two views, and the maps before and after each refinement: at most 111 bytes were seen, and 72.
    maps = width * height * (112 if options.smooth_paths else 90)
    size = (width, height, disparities)
    if options.smooth_paths:
        scratch, volume = smooth_paths.scratch_bytes(backend, *size), smooth_paths.volume_bytes(*size)
    else:
        scratch, volume = winners.scratch_bytes(backend, *size, options), winners.volume_bytes(*size, options)
    return maps + scratch + volume, max(width * height * 12, scratch, volume)
