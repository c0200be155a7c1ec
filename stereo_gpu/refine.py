"""Take wrong disparities away and fill small holes."""

from __future__ import annotations

import numpy as np

from stereo_gpu.backends import Backend, DeviceArray
from stereo_gpu.config import MatchOptions


def refine(
    backend: Backend,
    values: DeviceArray,
    validity: DeviceArray,
    other: DeviceArray,
    *,
    smallest: int,
    disparities: int,
    direction: int,
    options: MatchOptions,
) -> tuple[DeviceArray, DeviceArray]:
    """Left-right check, median, support, fill, median: each step that the options ask for.

    Args:
        backend: where the maps are.
        values, validity: (H, W) winners of the reference view and why some are missing.
        other: (H, W) int32, the other view's packed winners.
        smallest, disparities: the searched range.
        direction: 1 for the right view as reference, -1 for the left one.
        options: which steps, and how.

    Returns:
        New values and validity, on the device.
    """
    height, width = values.shape
    size = {"width": width, "height": height}

    def run(kernel: str, **arguments: DeviceArray | int | float) -> tuple[DeviceArray, DeviceArray]:
        outputs = {"disparity_out": backend.empty((height, width), np.float32)}
        if kernel != "median":
            arguments["validity"] = validity
            outputs["validity_out"] = backend.empty((height, width), np.uint8)
        backend.launch(kernel, disparity=values, **size, **arguments, **outputs)
        return outputs["disparity_out"], outputs.get("validity_out", validity)

    if options.consistency_px is not None:
        values, validity = run(
            "consistency",
            other=other,
            smallest=smallest,
            disparities=disparities,
            direction=direction,
            tolerance=options.consistency_px,
        )
    if options.median:
        values, validity = run("median", size=options.median)
    if options.support_share > 0:
        values, validity = run(
            "support",
            reach=options.support_reach,
            step=options.support_step,
            tolerance=options.same_surface_px,
            share=options.support_share,
        )
    if options.fill_reach:
        values, validity = run("fill", reach=options.fill_reach, tolerance=options.same_surface_px)
        if options.median:
            values, validity = run("median", size=options.median)
    return values, validity
