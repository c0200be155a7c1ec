"""Winner takes all over NCC, for both views: fused, or over a volume."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from stereo_gpu.backends import Backend, DeviceArray
from stereo_gpu.config import MatchOptions
from stereo_gpu.prepare import DeviceView


@dataclass(frozen=True, kw_only=True)
class Winners:
    """The best disparity of every pixel, on the device.

    Args:
        values: (H, W) float32, px; NaN where nothing matches.
        validity: (H, W) uint8, bits of Validity.
        score: (H, W) float32, of the winner: its NCC; after smooth paths the sum of its costs along them.
        ratio: (H, W) float32, runner-up over best, see peaks in kernels/; after smooth paths best over runner-up.
        other: (H, W) int32, the other view's winners, packed as winner_key in kernels/warp/peaks.py says; None after
            smooth paths, which match the other view on its own.
        noise: variance of the pictures' noise, grey levels^2, as smooth paths found it; else 0.
    """

    values: DeviceArray
    validity: DeviceArray
    score: DeviceArray
    ratio: DeviceArray
    other: DeviceArray | None = None
    noise: float = 0.0


def find_winners(
    backend: Backend,
    ours: DeviceView,
    theirs: DeviceView,
    *,
    smallest: int,
    disparities: int,
    direction: int,
    options: MatchOptions,
) -> Winners:
    """Find the best disparity of every pixel of our view, and of theirs.

    Args:
        backend: where the views are.
        ours, theirs: the reference view and the other one.
        smallest, disparities: the range to search.
        direction: 1 for the right view as reference, -1 for the left one.
        options: whether the volume is held, and the window.
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
    """Bytes of the volume that these options hold; 0 for the fused form."""
    return width * height * disparities * 4 if options.whole_volume else 0


def scratch_bytes(backend: Backend, width: int, height: int, disparities: int, options: MatchOptions) -> int:
    """Bytes of scratch that the kernels of these options take on a device."""
    if options.whole_volume:
        return 0
    size = {"width": width, "height": height, "disparities": disparities}
    return backend.scratch_bytes("ncc_wta", **size, radius=options.window // 2)
