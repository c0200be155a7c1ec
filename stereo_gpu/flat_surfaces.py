"""Give flat, textureless parts the plane of what is sure around them, and move what is sure to its sub-pixel place."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from stereo_gpu.backends import Backend, DeviceArray
from stereo_gpu.types import Floats
from stereo_gpu.winners import Winners

CELL = 4  # px; what is sure within it becomes one place of a surface
SPACING = 2  # cells from one plane to the next
REACH = 12  # cells around a plane that it is fitted to
ROUNDS = 4  # each sees the slopes of the one before; planes grow into islands that both views agree on by chance
EVERY = 2  # rows and columns between the pixels whose evidence is asked for
WINDOW = 2  # radius of the windows that tell evidence, px
LEAST_INFORMATION = 12.0  # 1 / px^2: a standard deviation of 0.3 px
AGREEMENT_REACH = 8  # px around a pixel that tell whether its winner can be trusted
LEAST_AGREEMENT = 0.6  # of these, that both views agree on: with less the winner is a guess
ON_PLANE = 0.5  # px from a plane
LEAST_SHARE = 0.65  # of what is sure around, that must lie on the plane
DAMPING = 50.0  # of a step, in variances of the noise: faint texture moves little
KEEP = 50.0  # 1 / px^2 that hold a disparity where it is: evidence to 0.14 px moves it half way
# How far a levelled pixel looks, px: every round at planes, their cells, and the windows of these.
LEVEL_REACH = ROUNDS * (CELL * (REACH + SPACING) + WINDOW + 2) + AGREEMENT_REACH
UNKNOWN = 1e6  # residual of a pixel that tells nothing, as in the kernel
LEAST_NOISE = 0.05  # variance, grey levels^2: under that of rounding


@dataclass(frozen=True, kw_only=True)
class Surroundings:
    """What the surfaces are found in.

    Args:
        reference, other: (H, W) float32, grey levels of the two views.
        guide: (3, H, W) uint8, colours of the reference view.
        direction: 1 for the right view as reference, -1 for the left one.
    """

    reference: DeviceArray
    other: DeviceArray
    guide: DeviceArray
    direction: int


@dataclass(frozen=True, kw_only=True)
class _Slopes:
    """Change of disparity a pixel, (H, W) float32 each."""

    x: DeviceArray
    y: DeviceArray


@dataclass(frozen=True, kw_only=True)
class _Evidence:
    """Where the pictures say that pixels lie, (H, W) float32 each.

    Args:
        moved: disparity after a step, px.
        information: of that step, 1 / px^2.
        residual: variance of what is left between the views, grey levels^2.
    """

    moved: DeviceArray
    information: DeviceArray
    residual: DeviceArray


def level_flats(
    backend: Backend, found: Winners, checked: Winners, around: Surroundings, noise: float = 0.0
) -> Winners:
    """Put pixels whose winners are guesses on the plane through the sure ones around them, where there is one plane.

    Args:
        backend: where the maps are.
        found: a map without holes.
        checked: the winners that both views agree on.
        around: the pictures.
        noise: variance of their noise, grey levels^2; 0 where it is to be measured.

    Returns:
        The map, with the pictures' noise.
    """
    height, width = found.values.shape
    flat = backend.zeros((height, width), np.float32)
    slopes = _Slopes(x=flat, y=flat)
    noise = noise or _noise(backend, _weigh(backend, found.values, slopes, around, noise=1.0))
    level, taken = found.values, backend.zeros((height, width), np.uint8)
    for _ in range(ROUNDS):
        own = _map(backend, level)
        backend.launch(
            "unfilled",
            disparity=level,
            validity=found.validity,
            taken=taken,
            width=width,
            height=height,
            disparity_out=own,
        )
        evidence = _weigh(backend, own, slopes, around, noise=noise)
        planes = _fit(backend, evidence)
        level, taken, slopes = _choose(backend, found, checked, taken, planes, around, noise)
    return dataclasses.replace(found, values=level, noise=noise)


def settle(backend: Backend, found: Winners, around: Surroundings) -> Winners:
    """Move each disparity once towards where the pictures agree best, as far as their texture tells.

    A Gauss-Newton step (Lucas and Kanade 1981) in windows that lean with the surface, without their offset.
    """
    size = {"width": found.values.shape[1], "height": found.values.shape[0]}
    slopes = _Slopes(x=_map(backend, found.values), y=_map(backend, found.values))
    backend.launch(
        "slopes",
        disparity=found.values,
        **size,
        reach=2,
        largest=1.0,
        along_x_out=slopes.x,
        along_y_out=slopes.y,
    )
    moved = _weigh(
        backend, found.values, slopes, around, noise=found.noise, stride=1, weighted=1, largest_step=0.25, keep=KEEP
    ).moved
    return dataclasses.replace(found, values=moved)


def _weigh(
    backend: Backend,
    disparity: DeviceArray,
    slopes: _Slopes,
    around: Surroundings,
    *,
    noise: float,
    stride: int = EVERY,
    weighted: int = 0,
    largest_step: float = 1.0,
    keep: float = 0.0,
) -> _Evidence:
    evidence = _Evidence(
        moved=_map(backend, disparity), information=_map(backend, disparity), residual=_map(backend, disparity)
    )
    backend.launch(
        "evidence",
        reference=around.reference,
        other=around.other,
        disparity=disparity,
        along_x=slopes.x,
        along_y=slopes.y,
        guide=around.guide,
        width=disparity.shape[1],
        height=disparity.shape[0],
        radius=WINDOW,
        stride=stride,
        direction=around.direction,
        weighted=weighted,
        noise=noise,
        damping=DAMPING,
        largest_step=largest_step,
        keep=keep,
        moved_out=evidence.moved,
        information_out=evidence.information,
        residual_out=evidence.residual,
    )
    return evidence


def _noise(backend: Backend, evidence: _Evidence) -> float:
    """Variance of a picture's noise: half of what most pixels differ by in the two views.

    In steps of the square root of 2, so that a picture and its first tile mostly have the same.
    """
    residual: Floats = backend.download(evidence.residual)[::EVERY, ::EVERY]
    known = residual[residual < UNKNOWN]
    if not known.size:
        return LEAST_NOISE
    noise = max(LEAST_NOISE, float(np.median(known)) / 2)
    return float(2.0 ** (round(2 * math.log2(noise)) / 2))


def _fit(backend: Backend, evidence: _Evidence) -> DeviceArray:
    """Planes through the evidence, one every CELL * SPACING px."""
    height, width = evidence.moved.shape
    wide, high = (-(-length // CELL) for length in (width, height))
    cells = backend.empty((4, high, wide), np.float32)
    backend.launch(
        "cells",
        moved=evidence.moved,
        information=evidence.information,
        width=width,
        height=height,
        cell=CELL,
        least=LEAST_INFORMATION,
        cells_out=cells,
    )
    planes_wide, planes_high = (-(-length // SPACING) for length in (wide, high))
    planes = backend.empty((4, planes_high, planes_wide), np.float32)
    backend.launch(
        "planes",
        cells=cells,
        cells_wide=wide,
        cells_high=high,
        planes_wide=planes_wide,
        planes_high=planes_high,
        cell=CELL,
        spacing=SPACING,
        reach=REACH,
        tolerance=ON_PLANE,
        planes_out=planes,
    )
    return planes


def _choose(
    backend: Backend,
    found: Winners,
    checked: Winners,
    taken: DeviceArray,
    planes: DeviceArray,
    around: Surroundings,
    noise: float,
) -> tuple[DeviceArray, DeviceArray, _Slopes]:
    """The map with planes where they are to be taken, where that is, and the planes' slopes everywhere."""
    height, width = found.values.shape
    size: dict[str, Any] = {"width": width, "height": height}
    agreement, plane, level = (_map(backend, found.values) for _ in range(3))
    slopes = _Slopes(x=_map(backend, found.values), y=_map(backend, found.values))
    wanted, now_taken = (backend.empty((height, width), np.uint8) for _ in range(2))
    backend.launch(
        "agreement", checked=checked.values, taken=taken, **size, radius=AGREEMENT_REACH, agreement_out=agreement
    )
    backend.launch(
        "flat",
        reference=around.reference,
        other=around.other,
        planes=planes,
        disparity=found.values,
        agreement=agreement,
        **size,
        planes_wide=planes.shape[2],
        planes_high=planes.shape[1],
        pitch=CELL * SPACING,
        direction=around.direction,
        noise=noise,
        least_agreement=LEAST_AGREEMENT,
        least_share=LEAST_SHARE,
        plane_out=plane,
        along_x_out=slopes.x,
        along_y_out=slopes.y,
        wanted_out=wanted,
    )
    backend.launch(
        "majority",
        wanted=wanted,
        plane=plane,
        disparity=found.values,
        **size,
        radius=2,
        disparity_out=level,
        taken_out=now_taken,
    )
    return level, now_taken, slopes


def _map(backend: Backend, like: DeviceArray) -> DeviceArray:
    return backend.empty(like.shape, np.float32)
