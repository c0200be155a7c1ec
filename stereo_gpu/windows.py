"""Match with several windows, and take at each pixel the smallest one that holds."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from stereo_gpu.backends import Backend, DeviceArray
from stereo_gpu.config import MatchOptions
from stereo_gpu.prepare import GreyLevels, make_grey, sum_windows
from stereo_gpu.refine import complete, drop_lonely, filter_median, verify
from stereo_gpu.timing import Stopwatch
from stereo_gpu.winners import Winners, find_winners


def match_windows(
    backend: Backend,
    pictures: tuple[DeviceArray, DeviceArray],
    levels: tuple[GreyLevels, GreyLevels],
    masks: tuple[DeviceArray, DeviceArray],
    search: dict[str, Any],
    options: MatchOptions,
    watch: Stopwatch,
) -> Winners:
    """Match with every window of `options.windows`, and choose one at each pixel.

    A small window keeps edges and thin things, a wide one finds its place where there is little texture. So each
    window's winners are checked against the other view's, filtered, and held against their surroundings, and a
    pixel takes the smallest window that passes. The median then takes away what lies alone among other windows'.

    Args:
        backend: the device.
        pictures: the reference view and the other one.
        levels: which of their values are black and white.
        masks: of the two.
        search: smallest, disparities and direction, as `find_winners` takes them.
        options: of the matching, with `windows`.
        watch: collects seconds a step.
    """
    with watch.step("norms"):
        greys = [make_grey(backend, *view, options) for view in zip(pictures, levels, strict=True)]
    found: Winners | None = None
    for window in options.windows:
        reach, step = surroundings(window)
        alone = dataclasses.replace(
            options, window=window, support_share=options.windows_share, support_reach=reach, support_step=step
        )
        with watch.step("norms"):
            ours, theirs = (sum_windows(backend, *view, alone) for view in zip(greys, masks, strict=True))
            backend.finish()
        with watch.step("correlation"):
            wider = find_winners(backend, ours, theirs, **search, options=alone)
            backend.finish()
        with watch.step("refinement"):
            wider = drop_lonely(backend, verify(backend, wider, **search, options=alone), alone)
            found = wider if found is None else _choose(backend, found, wider)
            backend.finish()
    assert found is not None  # there is always a first window
    with watch.step("refinement"):
        found = complete(backend, filter_median(backend, found, options), options)
        backend.finish()
    return found


def surroundings(window: int) -> tuple[int, int]:
    """How far a window's winner is held against others, and in which steps, px.

    Windows that overlap by more than half err together: between two pictures of noise, wide windows give flat patches
    as wide as themselves. So the steps grow with the window.
    """
    step = max(3, window // 2 + 1)
    return 3 * step, step


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
