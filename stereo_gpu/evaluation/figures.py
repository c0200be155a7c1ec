"""Pictures of an evaluation: where a map is wrong and by how much, which pixels count, what confidence is worth.

They take arrays and return uint8 RGB. What has no value is dark grey and what is not known mid grey in all of them.
"""

from __future__ import annotations

import cv2
import numpy as np

from stereo_gpu.evaluation.scores import ROUNDING, THRESHOLDS, Mask
from stereo_gpu.evaluation.sparsification import Curve
from stereo_gpu.figures import NO_VALUE, Colour, colour_classes, colour_disparity
from stereo_gpu.types import Bytes, Doubles, Floats

UNKNOWN: Colour = (128, 132, 138)
# From pale to dark, so that the order shows in grey and to the colour-blind as well.
ERROR_COLOURS: tuple[Colour, ...] = ((226, 232, 226), (253, 212, 140), (244, 140, 60), (205, 50, 60), (110, 10, 80))
OCCLUDED: Colour = (70, 120, 190)
VISIBLE: Colour = (226, 232, 226)
NEAR_JUMP: Colour = (244, 162, 39)

_PAPER, _INK = (250, 250, 250), (60, 64, 72)
_LINES: tuple[tuple[str, Colour], ...] = (
    ("map", (205, 50, 60)),
    ("oracle", (70, 120, 190)),
    ("random", (128, 132, 138)),
)


def colour_pair(values: Floats, truth: Floats) -> tuple[Bytes, Bytes]:
    """A map and its truth in the colours of one range, that of the truth, each with the scale beside it."""
    known = truth[np.isfinite(truth)]
    low, high = float(known.min()), float(known.max())
    return colour_disparity(values, low, high, bar=True), colour_disparity(truth, low, high, bar=True)


def colour_errors(values: Floats, truth: Floats, counted: Mask | None = None) -> Bytes:
    """Where a map is wrong by more than 0.5, 1, 2 and 4 px or has no value, (H + legend, W, 3).

    Args:
        values: (H, W) px, not finite where there is none.
        truth: (H, W) px, not finite where it is unknown.
        counted: (H, W) bool, the pixels to show; None shows all whose truth is known.
    """
    known = np.isfinite(truth) if counted is None else np.isfinite(truth) & counted
    given = np.isfinite(values)
    errors = np.abs(np.where(given, values, 0.0) - np.where(known, truth, 0.0))
    names = ["up to 0.5 px", "to 1", "to 2", "to 4", "over 4"]
    # The legend shows the last class first.
    named = [("not counted", UNKNOWN), ("no value", NO_VALUE), *zip(names[::-1], ERROR_COLOURS[::-1], strict=True)]
    best = len(named) - 1
    classes = (best - np.searchsorted(np.array(THRESHOLDS) + ROUNDING, errors)).astype(np.uint8)
    classes[~given] = 1
    classes[~known] = 0
    return colour_classes(classes, named)


def colour_masks(truth: Floats, visible: Mask, near: Mask) -> Bytes:
    """Which pixels are occluded, visible, and visible near jumps, (H + legend, W, 3).

    Args:
        truth: (H, W) px, not finite where it is unknown.
        visible: (H, W) bool, the non-occluded pixels.
        near: (H, W) bool, those of them near jumps of disparity.
    """
    named = [("truth unknown", UNKNOWN), ("occluded", OCCLUDED), ("visible", VISIBLE), ("near jumps", NEAR_JUMP)]
    classes = np.where(near, 3, np.where(visible, 2, 1)).astype(np.uint8)
    classes[~np.isfinite(truth)] = 0
    return colour_classes(classes, named)


def draw_sparsification(curve: Curve, *, name: str, size: tuple[int, int] = (640, 400)) -> Bytes:
    """Draw the error of what is kept over the share that is kept, beside the oracle's and random's.

    Args:
        curve: what `sparsify` found.
        name: what the upright axis shows, such as "bad-1.0".
        size: (width, height) of the picture, px.
    """
    width, height = size
    canvas = np.full((height, width, 3), _PAPER, np.uint8)
    left, top, right, floor = 70, 30, width - 20, height - 50
    highest = max(float(curve.rest.max()), curve.random_area, 1e-9) * 1.05

    def place(density: Doubles, error: Doubles) -> list[tuple[int, int]]:
        across = np.round(left + density * (right - left)).astype(int)
        up = np.round(floor - error / highest * (floor - top)).astype(int)
        return list(zip(across.tolist(), up.tolist(), strict=True))

    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        x, y = place(np.array([share]), np.array([share * highest]))[0]
        cv2.line(canvas, (x, floor), (x, top), (228, 230, 234), 1)
        cv2.line(canvas, (left, y), (right, y), (228, 230, 234), 1)
        _write(canvas, f"{share:.0%}", (x - 12, floor + 16))
        _write(canvas, f"{share * highest:.3g}", (8, y + 4))
    _write(canvas, "share of the given values that is kept, surest first", (left + 90, floor + 36))
    _write(canvas, name, (8, 16))
    curves = (curve.rest, curve.oracle, np.full_like(curve.rest, curve.random_area))
    areas = (curve.area, curve.oracle_area, curve.random_area)
    for index, ((label, colour), errors, area) in enumerate(zip(_LINES, curves, areas, strict=True)):
        points = np.array(place(curve.density, errors), np.int32)
        cv2.polylines(canvas, [points], False, colour, 2, cv2.LINE_AA)
        at = left + 90 + 165 * index
        cv2.line(canvas, (at, 12), (at + 22, 12), colour, 2)
        _write(canvas, f"{label}: area {area:.3g}", (at + 28, 16))
    return canvas


def _write(canvas: Bytes, text: str, at: tuple[int, int]) -> None:
    cv2.putText(canvas, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.4, _INK, 1, cv2.LINE_AA)
