"""Winner takes all, for both views: over fused NCC, over an NCC volume, or over costs smoothed along 8 paths."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from stereo_gpu.backends import Backend, DeviceArray
from stereo_gpu.config import MatchOptions
from stereo_gpu.prepare import DeviceView

EIGHT_PATHS = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1))
# Keeps the sum of 8 paths under 1, and as a power of two every sum exact.
PATH_WEIGHT = 1.0 / 4096.0


@dataclass(frozen=True, kw_only=True)
class Winners:
    """The best disparity of every pixel, on the device.

    Args:
        values: (H, W) float32, px; NaN where nothing matches.
        validity: (H, W) uint8, bits of Validity.
        score: (H, W) float32, of the winner: its NCC, or PATH_WEIGHT times what its 8 paths save.
        ratio: (H, W) float32, runner-up over best, see peaks in kernels/.
        other: (H, W) int32, the other view's winners, packed as winner_key in kernels/warp/peaks.py says.
    """

    values: DeviceArray
    validity: DeviceArray
    score: DeviceArray
    ratio: DeviceArray
    other: DeviceArray


@dataclass(frozen=True, kw_only=True)
class Volumes:
    """Memory of smooth paths on the device, (H, W, D): uint8 costs, and float32 sums of what the paths save."""

    cost: DeviceArray
    saved: DeviceArray


def make_volumes(backend: Backend, width: int, height: int, disparities: int) -> Volumes:
    """Take the memory that smooth paths need."""
    shape = (height, width, disparities)
    return Volumes(cost=backend.empty(shape, np.uint8), saved=backend.empty(shape, np.float32))


def find_winners(
    backend: Backend,
    ours: DeviceView,
    theirs: DeviceView,
    *,
    smallest: int,
    disparities: int,
    direction: int,
    options: MatchOptions,
    row_slope: int = 0,
    volumes: Volumes | None = None,
) -> Winners:
    """Find the best disparity of every pixel of our view, and of theirs.

    Args:
        backend: where the views are.
        ours, theirs: the reference view and the other one.
        smallest, disparities: the range to search.
        direction: 1 for the right view as reference, -1 for the left one.
        options: which measure, and its window or penalties.
        row_slope: disparity change a row, px, of the surfaces that smooth paths and census windows expect.
        volumes: memory for smooth paths, which may have been used before; None takes some.
    """
    height, width = ours.grey.shape
    found = Winners(
        values=backend.empty((height, width), np.float32),
        validity=backend.empty((height, width), np.uint8),
        score=backend.empty((height, width), np.float32),
        ratio=backend.empty((height, width), np.float32),
        other=backend.zeros((height, width), np.int32),
    )
    outputs: dict[str, Any] = {
        "disparity_out": found.values,
        "score_out": found.score,
        "ratio_out": found.ratio,
        "validity_out": found.validity,
        "other_out": found.other,
    }
    size: dict[str, Any] = {"width": width, "height": height}
    search: dict[str, Any] = {"smallest": smallest, "disparities": disparities, "direction": direction}
    take: dict[str, Any] = {"validity": ours.validity, "subpixel": int(options.subpixel)}
    if options.smooth_paths:
        volumes = volumes or make_volumes(backend, width, height, disparities)
        _smooth(backend, ours, theirs, size, search, row_slope, options, volumes)
        backend.launch("wta", volume=volumes.saved, **take, **size, **search, **outputs)
        return found
    views: dict[str, Any] = {
        "reference": ours.grey,
        "other": theirs.grey,
        "reference_sum": ours.window_sum,
        "reference_inverse": ours.inverse_norm,
        "other_sum": theirs.window_sum,
        "other_inverse": theirs.inverse_norm,
        "radius": options.window // 2,
    }
    if options.whole_volume:
        volume = backend.empty((height, width, disparities), np.float32)
        backend.launch("ncc_volume", **views, **size, **search, volume_out=volume)
        backend.launch("wta", volume=volume, **take, **size, **search, **outputs)
    else:
        backend.launch("ncc_wta", **views, **take, **size, **search, **outputs)
    return found


def volume_bytes(width: int, height: int, disparities: int, options: MatchOptions) -> int:
    """Bytes of the volumes that these options hold; 0 for the fused form."""
    cells = width * height * disparities
    return cells * 5 if options.smooth_paths else cells * 4 if options.whole_volume else 0


def scratch_bytes(backend: Backend, width: int, height: int, disparities: int, options: MatchOptions) -> int:
    """Bytes of scratch that the kernels of these options take on a device; a diagonal has the most lines."""
    size = {"width": width, "height": height, "disparities": disparities}
    if options.smooth_paths:
        return backend.scratch_bytes("aggregate", **size, step_x=1, step_y=1)
    return 0 if options.whole_volume else backend.scratch_bytes("ncc_wta", **size, radius=options.window // 2)


def _smooth(
    backend: Backend,
    ours: DeviceView,
    theirs: DeviceView,
    size: dict[str, Any],
    search: dict[str, Any],
    row_slope: int,
    options: MatchOptions,
    volumes: Volumes,
) -> None:
    """Census costs, aggregated along 8 paths: larger is better, 0 where there is no match."""
    height, width = ours.grey.shape
    bits = []
    for view, row_shift in ((ours, 0), (theirs, search["direction"] * row_slope)):
        bits.append(backend.empty((height, width, 2), np.int32))
        backend.launch("census", picture=view.grey, **size, row_shift=row_shift, bits_out=bits[-1])
    backend.launch(
        "census_volume",
        reference_bits=bits[0],
        other_bits=bits[1],
        reference_validity=ours.validity,
        other_validity=theirs.validity,
        **size,
        **search,
        cost_out=volumes.cost,
    )
    backend.clear(volumes.saved)
    for step_x, step_y in EIGHT_PATHS:
        backend.launch(
            "aggregate",
            cost=volumes.cost,
            picture=ours.grey,
            **size,
            disparities=search["disparities"],
            step_x=step_x,
            step_y=step_y,
            row_slope=row_slope,
            small_penalty=options.small_penalty,
            large_penalty=options.large_penalty,
            edge_penalty=options.edge_penalty,
            edge=options.edge_grey,
            weight=PATH_WEIGHT,
            volume_out=volumes.saved,
        )
