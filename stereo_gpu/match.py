"""Find the disparity of every pixel of the reference view."""

from __future__ import annotations

import dataclasses
from typing import Literal

import numpy as np

from stereo_gpu.backends import Backend, DeviceArray, open_backend
from stereo_gpu.config import PROFILES, MatchOptions, Profile
from stereo_gpu.errors import InputError
from stereo_gpu.images import check_pair
from stereo_gpu.prepare import grey_scale, prepare_view
from stereo_gpu.refine import better, complete, lean, verify
from stereo_gpu.timing import Stopwatch
from stereo_gpu.types import Bytes, Disparity, Floats, Picture, Validity, View
from stereo_gpu.winners import Winners, find_winners, volume_bytes

LARGEST_RANGE = 8192  # winner_key holds a disparity's index in 13 bits
Range = tuple[int, int] | Literal["auto"]


def match(
    left: Picture,
    right: Picture,
    *,
    disparities: Range = (0, 64),
    window: int | None = None,
    reference: str = "right",
    profile: str = "fast",
    mask: Bytes | None = None,
    other_mask: Bytes | None = None,
    backend: str | None = None,
) -> Disparity:
    """Match a rectified pair by normalized cross-correlation, winner takes all.

    Args:
        left, right: rectified pictures of one size, (H, W) or (H, W, 3), uint8 or uint16.
        disparities: smallest disparity and how many to search, px, or "auto" to find the range first.
        window: side of the correlation window, px, odd, 3 to 31; None takes the profile's.
        reference: the view that the map is laid out on, "right" as in the paper, or "left".
        profile: "paper" (the paper's appendix and median filter), "fast" or "precise".
        mask: (H, W), 0 where the reference view is not to be matched.
        other_mask: (H, W), 0 where the other view has no content.
        backend: where to compute; None takes STEREO_GPU_BACKEND, else the best device.

    Returns:
        The map; in profile "paper" `numpy.nan_to_num(values)` is the paper's own map, 0 where nothing correlates.

    Raises:
        InputError: a picture, mask or option is wrong.
        MemoryLimitError: the job does not fit the device.

    Source: Medina-Zegarra and Lobaton, "3-D Visual Reconstruction: A System Perspective", appendix.
    """
    check_pair(left, right)
    view, chosen = parse_view(reference), parse_profile(profile)
    options = PROFILES[chosen] if window is None else dataclasses.replace(PROFILES[chosen], window=window)
    device = open_backend(backend)
    masks = [_mask(m, left.shape[:2], name) for m, name in ((mask, "mask"), (other_mask, "other_mask"))]
    if disparities == "auto":
        from stereo_gpu.disparity_range import find_range

        valid_left, valid_right = masks if view is View.LEFT else masks[::-1]
        disparities = find_range(device, left, right, valid_left, valid_right)
    smallest, count = check_range(disparities, left.shape[1])
    check_options(options)
    watch = Stopwatch()
    pictures = [device.upload(picture) for picture in (left, right)]
    found = match_on(
        device,
        pictures[0],
        pictures[1],
        scales=(grey_scale(left), grey_scale(right)),
        masks=(device.upload(masks[0]), device.upload(masks[1])),
        smallest=smallest,
        disparities=count,
        reference=view,
        options=options,
        watch=watch,
    )
    return download_disparity(device, found, smallest, count, view, chosen, options, watch)


def match_on(
    backend: Backend,
    left: DeviceArray,
    right: DeviceArray,
    *,
    scales: tuple[float, float],
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
        scales: factors that take the left and right picture's values to 0..255.
        masks: of the reference view and of the other one, on the device.
        smallest, disparities: the range to search.
        reference: the view that the map is laid out on.
        options: of the matching.
        watch: collects seconds a step.

    Raises:
        MemoryLimitError: the job does not fit the device.
    """
    check_match_memory(backend, left.shape[1], left.shape[0], disparities, options)
    with watch.step("norms"):
        views = [prepare_view(backend, left, scales[0], masks[reference is View.RIGHT], options)]
        views += [prepare_view(backend, right, scales[1], masks[reference is View.LEFT], options)]
        backend.finish()
    ours, theirs = views if reference is View.LEFT else views[::-1]
    search = {"smallest": smallest, "disparities": disparities, "direction": 1 if reference is View.RIGHT else -1}
    found: Winners | None = None
    for row_slope in options.row_slopes:
        with watch.step("correlation"):
            winners = find_winners(backend, ours, theirs, **search, row_slope=row_slope, options=options)
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


def check_options(options: MatchOptions) -> None:
    """Refuse a window that no kernel can take.

    Raises:
        InputError: with the window.
    """
    if options.window % 2 == 0 or not 3 <= options.window <= 31:
        raise InputError(f"window = {options.window}: it must be odd and from 3 to 31")


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
    """Copy a map back; confidence is the NCC, less the more a second peak comes close to it where one is known."""
    values, validity = backend.download(found.values), backend.download(found.validity)
    score: Floats = backend.download(found.score)
    ratio: Floats = backend.download(found.ratio)
    good = validity == 0
    return Disparity(
        values=values,
        validity=validity,
        confidence=np.where(good, np.clip(score if options.slant_rounds else score * (1 - ratio), 0, 1), np.float32(0)),
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
    pixels = width * height
    # Two pictures, two views with sums, and the maps before and after each refinement.
    needed, largest = pixels * 90, pixels * 12
    remedy = "use smaller pictures"
    volume = volume_bytes(width, height, disparities, options)
    if volume:
        largest = max(largest, volume)
        needed += volume
        remedy = "use profile fast, which never holds a cost volume, or fewer disparities"
    backend.check_memory(needed, largest, remedy)


def _mask(mask: Bytes | None, shape: tuple[int, ...], name: str) -> Bytes:
    if mask is None:
        return np.ones(shape, np.uint8)
    if mask.shape != shape:
        raise InputError(
            f"{name} is {mask.shape[::-1]}, the pictures are {shape[::-1]}: give one value a pixel, 0 to leave out"
        )
    return np.asarray(mask != 0, np.uint8)


def coverage(disparity: Disparity) -> float:
    """Share of the pixels that are not masked which have a value."""
    wanted = (disparity.validity & Validity.MASKED) == 0
    return float(np.isfinite(disparity.values[wanted]).mean()) if wanted.any() else 0.0
