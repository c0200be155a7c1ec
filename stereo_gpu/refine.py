"""Take wrong disparities away, filter the rest, and fill small holes."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from stereo_gpu.backends import Backend, DeviceArray
from stereo_gpu.config import MatchOptions
from stereo_gpu.winners import Winners


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
        found = launch_on_map(
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
    return launch_on_map(
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
        found = launch_on_map(
            backend,
            "fill",
            found,
            axis=0,
            reach=options.fill_reach,
            near=1,
            edges=0,
            tolerance=options.same_surface_px,
        )
        found = filter_median(backend, found, options)
    return found


def launch_on_map(backend: Backend, kernel: str, found: Winners, **arguments: Any) -> Winners:
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
