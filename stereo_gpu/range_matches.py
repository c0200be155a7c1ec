"""Match small pictures over a long range and keep the surfaces: what a range of disparities is told from."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_gpu.backends import Backend
from stereo_gpu.config import MatchOptions
from stereo_gpu.device_match import match_on
from stereo_gpu.prepare import Levels
from stereo_gpu.timing import Stopwatch
from stereo_gpu.types import Bytes, Floats, Ints, View

# Nothing but winners that both views agree on. Filters would take away what is thin, and that is often the nearest.
OPTIONS = MatchOptions(window=5, texture_threshold=0.5, subpixel=True, consistency_px=1.0)
TOOTH = 48  # rows
BETTER = 0.03  # a leaning surface must correlate better by this much where a frontal one was found
SAME_PX = 1.0  # neighbours that differ by no more are one surface
SMALL = 24  # px, smallest surface that counts at all
# Surfaces of so many px that lie anywhere are no chance matches; share of the picture, and the least.
SURE_SHARE, SURE = 0.001, 120
LEANING = 4  # leaning surfaces must be so many times larger: between teeth, chance finds more of them


@dataclass(frozen=True, kw_only=True)
class Surfaces:
    """Disparities of what was found, in px of the pictures that were matched.

    Args:
        values: of every pixel of a surface, sorted.
        sure: of those that belong to a large surface, sorted.
        least: how many px make a large surface.
        width, height: of the pictures.
        wanted: how many pixels of them were to be matched.
    """

    values: Floats
    sure: Floats
    least: int
    width: int
    height: int
    wanted: int


def find_surfaces(
    backend: Backend, pictures: list[Bytes], masks: list[Bytes], smallest: int, disparities: int
) -> Surfaces:
    """Match frontal surfaces, and those that come 1 px nearer with every row, as a table does.

    Args:
        backend: where to compute.
        pictures: left and right, (H, W) uint8.
        masks: of the left and right picture, (H, W), 0 where it has no content.
        smallest, disparities: the range to search.
    """
    height, width = pictures[0].shape
    least = int(max(SURE, SURE_SHARE * width * height))
    frontal, score = _match(backend, pictures, masks, np.zeros(height, np.int32), smallest, disparities)
    best = np.where(np.isfinite(frontal), score, -1.0)
    # Shifted row by row, a table faces the camera. Starting anew at each tooth keeps the longer range short.
    rows = (height - 1 - np.arange(height)) % TOOTH - TOOTH // 2
    leaning, score = _match(backend, pictures, masks, rows.astype(np.int32), smallest, disparities)
    leaning[~(score > best + BETTER)] = np.nan
    values: list[Floats] = []
    sure: list[Floats] = []
    for found, shift, factor in ((frontal, 0, 1), (leaning, rows[:, None], LEANING)):
        for size, into in ((SMALL, values), (least, sure)):
            kept = _without_specks(found, size * factor)
            into.append((found - shift)[kept])
    wanted = min(int(np.count_nonzero(mask)) for mask in masks)
    return Surfaces(
        values=np.sort(np.concatenate(values)),
        sure=np.sort(np.concatenate(sure)),
        least=least,
        width=width,
        height=height,
        wanted=wanted,
    )


def _match(
    backend: Backend, pictures: list[Bytes], masks: list[Bytes], rows: Ints, smallest: int, disparities: int
) -> tuple[Floats, Floats]:
    """Disparities with `rows` added, NaN where there is none, and scores, with the right picture's rows shifted."""
    width = pictures[0].shape[1]
    shift = rows[:, None]
    right, right_mask = pictures[1], masks[1]
    farthest = int(np.abs(rows).max())
    if farthest:
        source = np.arange(width) + shift
        inside = (source >= 0) & (source < width)
        source = np.clip(source, 0, width - 1)
        right = np.take_along_axis(right, source, 1)
        right_mask = np.where(inside, np.take_along_axis(right_mask, source, 1), np.uint8(0))
    found = match_on(
        backend,
        backend.upload(pictures[0]),
        backend.upload(np.ascontiguousarray(right)),
        levels=(Levels(), Levels()),
        masks=(backend.upload(masks[0]), backend.upload(np.ascontiguousarray(right_mask))),
        smallest=smallest - farthest,
        disparities=disparities + 2 * farthest,
        reference=View.LEFT,
        options=OPTIONS,
        watch=Stopwatch(),
    )
    values: Floats = backend.download(found.values).copy()
    score: Floats = backend.download(found.score)
    true = values - shift
    partner = np.arange(width) - true
    # Cameras leave columns at a picture's edge that are black or repeated: alike in both, they match at 0.
    edge = OPTIONS.window
    outside = (true < smallest) | (true > smallest + disparities - 1) | (partner < edge) | (partner >= width - edge)
    values[outside] = np.nan
    values[:, :edge] = values[:, width - edge :] = np.nan
    return values, score


def _without_specks(values: Floats, smallest: int) -> NDArray[np.bool_]:
    """Where values belong to a connected surface of so many px or more."""
    steps, nothing = 8, -(2**15)  # of a pixel; what filterSpeckles takes are whole numbers of 16 bits
    whole = np.where(np.isfinite(values), np.round(values * steps), nothing).astype(np.int16)
    cv2.filterSpeckles(whole, nothing, smallest - 1, SAME_PX * steps)
    return np.asarray(whole != nothing)
