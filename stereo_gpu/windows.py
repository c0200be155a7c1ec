"""Match with one window, or with several, of which each pixel takes the smallest one that holds."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from stereo_gpu.backends import Backend, DeviceArray
from stereo_gpu.config import MatchOptions
from stereo_gpu.prepare import Levels, make_grey, sum_windows
from stereo_gpu.refine import complete, drop_lonely, filter_median, verify
from stereo_gpu.timing import Stopwatch
from stereo_gpu.winners import Winners, find_winners


def match_windows(
    backend: Backend,
    pictures: tuple[DeviceArray, DeviceArray],
    levels: tuple[Levels, Levels],
    masks: tuple[DeviceArray, DeviceArray],
    search: dict[str, Any],
    options: MatchOptions,
    watch: Stopwatch,
) -> Winners:
    """Match with a window, or at each pixel with one of several.

    A small window keeps edges and thin things, a wide one finds its place where there is little texture. So each
    of `options.windows` has its winners checked against the other view's, filtered, and held against their
    surroundings, and a pixel takes the smallest window that passes. The median then takes away what lies alone among
    other windows'.

    Args:
        backend: the device.
        pictures: the reference view and the other one.
        levels: of their values.
        masks: of the two.
        search: smallest, disparities and direction, as `find_winners` takes them.
        options: of the matching.
        watch: collects seconds a step.
    """
    with watch.step("norms"):
        greys = [
            make_grey(backend, picture, level.grey, options) for picture, level in zip(pictures, levels, strict=True)
        ]
    if not options.windows:
        found = _match_window(backend, greys, masks, search, options, watch)
        with watch.step("refinement"):
            found = complete(backend, found, options)
            backend.finish()
        return found
    chosen: Winners | None = None
    for window in options.windows:
        reach, step = surroundings(window)
        alone = dataclasses.replace(
            options, window=window, support_share=options.windows_share, support_reach=reach, support_step=step
        )
        wider = _match_window(backend, greys, masks, search, alone, watch)
        with watch.step("refinement"):
            wider = drop_lonely(backend, wider, alone)
            chosen = wider if chosen is None else _choose(backend, chosen, wider)
            backend.finish()
    assert chosen is not None  # there is always a first window
    with watch.step("refinement"):
        chosen = complete(backend, filter_median(backend, chosen, options), options)
        backend.finish()
    return chosen


def surroundings(window: int) -> tuple[int, int]:
    """How far a window's winner is held against others, and in which steps, px.

    Windows that overlap by more than half err together: between two pictures of noise, wide windows give flat patches
    as wide as themselves. So the steps grow with the window.
    """
    step = max(3, window // 2 + 1)
    return 3 * step, step


def _match_window(
    backend: Backend,
    greys: list[DeviceArray],
    masks: tuple[DeviceArray, DeviceArray],
    search: dict[str, Any],
    options: MatchOptions,
    watch: Stopwatch,
) -> Winners:
    """The winners of one window, checked and filtered."""
    with watch.step("norms"):
        ours, theirs = (sum_windows(backend, *view, options) for view in zip(greys, masks, strict=True))
        backend.finish()
    with watch.step("correlation"):
        found = find_winners(backend, ours, theirs, **search, options=options)
        backend.finish()
    with watch.step("refinement"):
        found = verify(backend, found, **search, options=options)
        backend.finish()
    return found


def _choose(backend: Backend, found: Winners, wider: Winners) -> Winners:
    """Of the maps of two windows, the smaller one's wherever it has a value."""
    height, width = found.values.shape
    values, score, ratio = (backend.empty((height, width), np.float32) for _ in range(3))
    validity = backend.empty((height, width), np.uint8)
    backend.launch(
        "choose",
        disparity=found.values,
        score=found.score,
        ratio=found.ratio,
        validity=found.validity,
        wider_disparity=wider.values,
        wider_score=wider.score,
        wider_ratio=wider.ratio,
        wider_validity=wider.validity,
        width=width,
        height=height,
        disparity_out=values,
        score_out=score,
        ratio_out=ratio,
        validity_out=validity,
    )
    return dataclasses.replace(found, values=values, score=score, ratio=ratio, validity=validity)
