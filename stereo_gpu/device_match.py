"""Match two rectified pictures that are on a device; the map stays there until it is downloaded."""

from __future__ import annotations

import dataclasses

import numpy as np

from stereo_gpu.backends import Backend, DeviceArray
from stereo_gpu.config import MatchOptions, Profile
from stereo_gpu.prepare import GreyLevels, prepare_view
from stereo_gpu.refine import better, complete, lean, verify
from stereo_gpu.timing import Stopwatch
from stereo_gpu.types import Bytes, Disparity, Floats, Validity, View
from stereo_gpu.windows import match_windows
from stereo_gpu.winners import Winners, find_winners, make_volumes, scratch_bytes, volume_bytes

# A map is believed if this share of its pixels has an NCC over that.
SURE_SHARE, SURE_SCORE = 0.05, 0.5


def match_on(
    backend: Backend,
    left: DeviceArray,
    right: DeviceArray,
    *,
    levels: tuple[GreyLevels, GreyLevels],
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
        levels: which values of the left and right picture are black and white.
        masks: of the reference view and of the other one, on the device.
        smallest, disparities: the range to search.
        reference: the view that the map is laid out on.
        options: of the matching.
        watch: collects seconds a step.

    Raises:
        MemoryLimitError: the job does not fit the device.
    """
    found = match_part(
        backend,
        left,
        right,
        levels=levels,
        masks=masks,
        smallest=smallest,
        disparities=disparities,
        reference=reference,
        options=options,
        watch=watch,
    )
    if not options.smooth_paths or is_founded(
        *count_sure(backend.download(found.values), backend.download(found.score))
    ):
        return found
    values, validity = (backend.download(array) for array in (found.values, found.validity))
    drop_all(values, validity)
    return dataclasses.replace(found, values=backend.upload(values), validity=backend.upload(validity))


def match_part(
    backend: Backend,
    left: DeviceArray,
    right: DeviceArray,
    *,
    levels: tuple[GreyLevels, GreyLevels],
    masks: tuple[DeviceArray, DeviceArray],
    smallest: int,
    disparities: int,
    reference: View,
    options: MatchOptions,
    watch: Stopwatch,
) -> Winners:
    """Match a part of two pictures; whether the map is founded is for its caller to judge, who sees the whole of it.

    Arguments and errors are those of `match_on`.
    """
    check_match_memory(backend, left.shape[1], left.shape[0], disparities, options)
    search = {"smallest": smallest, "disparities": disparities, "direction": 1 if reference is View.RIGHT else -1}
    if options.windows:
        pictures, ends = ((left, right), levels) if reference is View.LEFT else ((right, left), levels[::-1])
        return match_windows(backend, pictures, ends, masks, search, options, watch)
    with watch.step("norms"):
        views = [prepare_view(backend, left, levels[0], masks[reference is View.RIGHT], options)]
        views += [prepare_view(backend, right, levels[1], masks[reference is View.LEFT], options)]
        backend.finish()
    ours, theirs = views if reference is View.LEFT else views[::-1]
    found: Winners | None = None
    # Fresh memory costs as much as several paths, so that the slopes share it.
    volumes = make_volumes(backend, left.shape[1], left.shape[0], disparities) if options.smooth_paths else None
    for row_slope in options.row_slopes:
        with watch.step("correlation"):
            winners = find_winners(
                backend, ours, theirs, **search, row_slope=row_slope, options=options, volumes=volumes
            )
            backend.finish()
        with watch.step("refinement"):
            winners = verify(backend, winners, **search, options=options)
            winners = lean(
                backend,
                winners,
                ours,
                theirs,
                search["direction"],
                rounds=options.slant_rounds,
                step_px=options.slant_step_px,
                options=options,
            )
            found = winners if found is None else better(backend, found, winners)
            backend.finish()
    assert found is not None  # there is always a first slope
    volumes = None
    with watch.step("refinement"):
        found = complete(backend, found, options)
        # Once more, now that holes are filled and the two slopes' maps meet.
        found = lean(
            backend,
            found,
            ours,
            theirs,
            search["direction"],
            rounds=options.slant_last_rounds,
            step_px=options.slant_step_px / 2,
            options=options,
        )
        backend.finish()
    return found


def count_sure(values: Floats, score: Floats) -> tuple[int, int]:
    """How many pixels have a value that correlates well, and how many have a value."""
    given = np.isfinite(values)
    return int((score[given] > SURE_SCORE).sum()), int(given.sum())


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
    """Copy a map back; confidence is the NCC, less the closer the runner-up comes to it where one is known."""
    height, width = found.values.shape
    confidence = backend.empty((height, width), np.float32)
    backend.launch(
        "confidence",
        score=found.score,
        ratio=found.ratio,
        validity=found.validity,
        width=width,
        height=height,
        # The score of leaning windows is another measure than that of the runner-up.
        weight=0.0 if options.slant_rounds else 1.0,
        confidence_out=confidence,
    )
    return Disparity(
        values=backend.download(found.values),
        validity=backend.download(found.validity),
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
    if volume_bytes(width, height, disparities, options):
        remedy = "use profile fast, which never holds a cost volume, or fewer disparities"
    backend.check_memory(*match_bytes(backend, width, height, disparities, options), remedy)


def match_bytes(backend: Backend, width: int, height: int, disparities: int, options: MatchOptions) -> tuple[int, int]:
    """Estimate what a match takes on a device: bytes in all, and of the largest array."""
    # Two pictures, two views with sums, and the maps before and after each refinement.
    maps = width * height * 90
    scratch = scratch_bytes(backend, width, height, disparities, options)
    volume = volume_bytes(width, height, disparities, options)
    return maps + scratch + volume, max(width * height * 12, scratch, volume)
