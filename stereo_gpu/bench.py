"""Time the kernels and the whole match against OpenCV's block matcher, in one run on one input."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import cv2
import numpy as np

from stereo_gpu.backends import Backend, open_backend
from stereo_gpu.config import PROFILES, MatchOptions, Profile
from stereo_gpu.device_match import check_match_memory
from stereo_gpu.errors import InputError
from stereo_gpu.match import match
from stereo_gpu.prepare import prepare_view
from stereo_gpu.types import Bytes
from stereo_gpu.winners import find_winners, volume_bytes

WARM_UP_SECONDS = 1.0
REPEATS = 11
LARGEST_SIDE = 16_384  # px


def run_bench(
    width: int, height: int, disparities: int, *, window: int = 11, backend: str | None = None
) -> Iterator[str]:
    """Time a random texture with a slope; yields a line a measurement, medians of REPEATS warm runs.

    The peer is cv2.StereoBM, which sums absolute differences, with all its threads. Times are of this machine
    and this moment; the ratios in one run are what can be compared.

    Args:
        width, height: size of the pictures, px.
        disparities: how many to search; a multiple of 16, as StereoBM wants it.
        window: side of the window, px; odd and at least 5, as StereoBM wants it.
        backend: where to compute; None takes the best device.

    Raises:
        InputError: a size is wrong.
        MemoryLimitError: the job does not fit the device.
    """
    if disparities < 16 or disparities % 16 or window < 5 or window % 2 == 0 or window > 31:
        raise InputError(
            f"{disparities} disparities and window {window}: StereoBM takes a multiple of 16, and 5 to 31, odd"
        )
    if not (disparities + window < width <= LARGEST_SIDE and window < height <= LARGEST_SIDE):
        raise InputError(
            f"size {width} x {height}: give more px than disparities and window take, at most {LARGEST_SIDE} a side"
        )
    device = open_backend(backend)
    options = MatchOptions(window=window, texture_threshold=0.5, subpixel=True)
    check_match_memory(device, width, height, disparities, options)
    left, right = _pair(width, height, disparities)
    peer = cv2.StereoBM.create(disparities, window)
    everywhere = device.upload(np.ones((height, width), np.uint8))
    views = [prepare_view(device, device.upload(p), 1.0, everywhere, options) for p in (right, left)]

    def fused() -> None:
        find_winners(device, views[0], views[1], smallest=0, disparities=disparities, direction=1, options=options)
        device.finish()

    peer_seconds = _median_seconds(lambda: peer.compute(left, right))
    cells = width * height * disparities
    yield f"{width} x {height} x {disparities}, window {window}, {device.name} ({device.device})"
    yield _line("cv2.StereoBM", peer_seconds, peer_seconds, cells)
    yield _line("kernel ncc_wta", _median_seconds(fused), peer_seconds, cells)
    for profile in _profiles(device, width, height, disparities):

        def whole(profile: Profile = profile) -> None:
            match(left, right, disparities=(0, disparities), window=window, profile=profile, backend=device.name)

        yield _line(f"sg.match {profile}", _median_seconds(whole), peer_seconds, cells)


def _profiles(device: Backend, width: int, height: int, disparities: int) -> list[Profile]:
    """The profiles that fit the device's memory; a cost volume may not."""
    total, one = device.available_bytes()
    held = {profile: volume_bytes(width, height, disparities, PROFILES[profile]) for profile in Profile}
    return [profile for profile in Profile if held[profile] < one and 2 * held[profile] < total]


def _pair(width: int, height: int, disparities: int) -> tuple[Bytes, Bytes]:
    noise = np.random.default_rng(0).integers(0, 256, (height, width + disparities)).astype(np.float32)
    texture = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 1.5), None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    slope = np.linspace(0.1, 0.8, height, dtype=np.float32)[:, None] * disparities
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    left = cv2.remap(texture, np.maximum(x - slope + disparities, 0), y, cv2.INTER_LINEAR)
    return left, np.ascontiguousarray(texture[:, disparities : disparities + width])


def _median_seconds(work: Callable[[], object]) -> float:
    end = time.perf_counter() + WARM_UP_SECONDS
    work()
    while time.perf_counter() < end:
        work()
    taken = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        work()
        taken.append(time.perf_counter() - start)
    return float(np.median(taken))


def _line(name: str, seconds: float, peer: float, cells: int) -> str:
    return f"{name:<16} {1000 * seconds:9.1f} ms {cells / seconds / 1e9:7.2f} GDE/s {seconds / peer:7.2f} x StereoBM"
