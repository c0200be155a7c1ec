"""Take wrong disparities away, move the rest to the peak of windows that lean, and fill small holes."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from stereo_gpu.backends import Backend, DeviceArray
from stereo_gpu.config import MatchOptions
from stereo_gpu.prepare import DeviceView
from stereo_gpu.winners import Winners

# A rival map must correlate better by this much: frontal windows are right where both fit alike.
RIVAL_MARGIN = 0.03


def verify(
    backend: Backend, found: Winners, *, smallest: int, disparities: int, direction: int, options: MatchOptions
) -> Winners:
    """Left-right check and median, as the options ask for.

    Args:
        backend: where the maps are.
        found: the winners of the reference view.
        smallest, disparities: the searched range.
        direction: 1 for the right view as reference, -1 for the left one.
        options: which steps, and how.
    """
    if options.consistency_px is not None:
        found = _run(
            backend,
            "consistency",
            found,
            other=found.other,
            smallest=smallest,
            disparities=disparities,
            direction=direction,
            tolerance=options.consistency_px,
        )
    return filter_median(backend, found, options)


def drop_lonely(backend: Backend, found: Winners, options: MatchOptions) -> Winners:
    """Take values away that their surroundings do not share, if the options ask for it."""
    if options.support_share <= 0:
        return found
    return _run(
        backend,
        "support",
        found,
        reach=options.support_reach,
        step=options.support_step,
        tolerance=options.same_surface_px,
        slope=options.support_slope,
        share=options.support_share,
    )


def filter_median(backend: Backend, found: Winners, options: MatchOptions) -> Winners:
    """Median of each pixel's neighbours that have a value, if the options ask for it."""
    if not options.median:
        return found
    height, width = found.values.shape
    values = backend.empty((height, width), np.float32)
    backend.launch(
        "median", disparity=found.values, width=width, height=height, size=options.median, disparity_out=values
    )
    return dataclasses.replace(found, values=values)


def complete(backend: Backend, found: Winners, options: MatchOptions) -> Winners:
    """Drop what its surroundings do not share, fill small holes, and filter again, as the options ask for."""
    found = drop_lonely(backend, found, options)
    if options.fill_reach:
        found = _run(backend, "fill", found, reach=options.fill_reach, tolerance=options.same_surface_px)
        found = filter_median(backend, found, options)
    return found


def lean(
    backend: Backend,
    found: Winners,
    ours: DeviceView,
    theirs: DeviceView,
    direction: int,
    *,
    rounds: int,
    step_px: float,
    options: MatchOptions,
) -> Winners:
    """Move each disparity to the NCC peak of windows that lean with the surface, in rounds of halving steps.

    The slopes come from the map, so each round sees better ones. The new score is the NCC.

    Args:
        backend: where the maps are.
        found: the disparities.
        ours, theirs: the reference view and the other one.
        direction: 1 for the right view as reference, -1 for the left one.
        rounds: how often; 0 for not at all.
        step_px: how far a disparity may move in the first round, px.
        options: window and largest slope.
    """
    height, width = found.values.shape
    for _ in range(rounds):
        moved = [backend.empty((height, width), np.float32) for _ in range(2)]
        backend.launch(
            "slant",
            reference=ours.grey,
            other=theirs.grey,
            disparity=found.values,
            width=width,
            height=height,
            radius=options.window // 2,
            direction=direction,
            step=step_px,
            largest_slope=options.slant_slope,
            disparity_out=moved[0],
            score_out=moved[1],
        )
        found = dataclasses.replace(found, values=moved[0], score=moved[1])
        step_px /= 2
    return found


def better(backend: Backend, found: Winners, rival: Winners) -> Winners:
    """Of two maps, the one that correlates better at each pixel."""
    height, width = found.values.shape
    values, score = (backend.empty((height, width), np.float32) for _ in range(2))
    validity = backend.empty((height, width), np.uint8)
    backend.launch(
        "merge",
        disparity=found.values,
        score=found.score,
        validity=found.validity,
        rival_disparity=rival.values,
        rival_score=rival.score,
        rival_validity=rival.validity,
        width=width,
        height=height,
        margin=RIVAL_MARGIN,
        disparity_out=values,
        score_out=score,
        validity_out=validity,
    )
    return dataclasses.replace(found, values=values, score=score, validity=validity)


def _run(backend: Backend, kernel: str, found: Winners, **arguments: Any) -> Winners:
    """Launch a kernel that takes a map and its validity to new ones."""
    height, width = found.values.shape
    values: DeviceArray = backend.empty((height, width), np.float32)
    validity: DeviceArray = backend.empty((height, width), np.uint8)
    backend.launch(
        kernel,
        disparity=found.values,
        validity=found.validity,
        width=width,
        height=height,
        **arguments,
        disparity_out=values,
        validity_out=validity,
    )
    return dataclasses.replace(found, values=values, validity=validity)
