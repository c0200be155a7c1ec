"""Pictures for people: disparity in colours, rectified rows with level lines, what was masked and why.

All take arrays and return uint8 RGB pictures of the same size unless they say otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_gpu.errors import InputError, PictureError
from stereo_gpu.types import Bytes, Floats, Picture, Validity

Colour = tuple[int, int, int]

NO_VALUE: Colour = (43, 45, 49)
_OUTLIERS = 1.0  # per cent of the values at either end that may fall off the colour scale
GAP = 8  # px between two pictures side by side
_PAPER: Colour = (250, 250, 250)
_INK: Colour = (60, 64, 72)
_LINES: tuple[Colour, ...] = ((230, 57, 70), (244, 162, 39), (76, 201, 120), (58, 134, 255), (199, 92, 230))
_FONT = cv2.FONT_HERSHEY_SIMPLEX

# In the order of precedence: a masked pixel is shown as masked whatever else is known of it.
VALIDITY_COLOURS: dict[str, tuple[int, Colour]] = {
    "masked": (Validity.MASKED, (90, 94, 102)),
    "filled": (Validity.FILLED, (126, 200, 227)),
    "occluded": (Validity.OCCLUDED, (244, 162, 39)),
    "mismatch": (Validity.MISMATCH, (214, 64, 69)),
    "textureless": (Validity.TEXTURELESS, (150, 110, 190)),
    "out of range": (Validity.OUT_OF_RANGE, (30, 60, 120)),
    "good": (0, (226, 232, 226)),
}


def as_rgb(picture: Picture) -> Bytes:
    """Make a picture 8 bits deep and (H, W, 3), grey repeated; 16 bits are scaled by 1/257.

    Raises:
        PictureError: neither (H, W) nor (H, W, 3), or neither 8 nor 16 bits deep.
    """
    if picture.ndim not in (2, 3) or (picture.ndim == 3 and picture.shape[2] != 3):
        raise PictureError(f"a picture of shape {picture.shape} cannot be shown: give (H, W) or (H, W, 3)")
    if picture.dtype == np.uint16:
        picture = np.round(picture / 257.0).astype(np.uint8)
    if picture.dtype != np.uint8:
        raise PictureError(f"a picture of {picture.dtype} cannot be shown: give uint8 or uint16")
    coloured = picture if picture.ndim == 3 else np.repeat(picture[..., None], 3, axis=2)
    return np.ascontiguousarray(coloured)


def colour_disparity(
    values: Floats, smallest: float | None = None, largest: float | None = None, *, bar: bool = False
) -> Bytes:
    """Colour a disparity map, near is red and far is blue; pixels without a value are dark grey.

    Args:
        values: (H, W) px, NaN where there is none.
        smallest: disparity at the blue end; None leaves out the lowest 1 % of the values.
        largest: disparity at the red end; None leaves out the highest 1 %.
        bar: append the colour scale with its numbers to the right, which widens the picture.
    """
    valid = np.isfinite(values)
    known = values[valid]
    ends = np.percentile(known, [_OUTLIERS, 100 - _OUTLIERS]) if known.size else (0.0, 0.0)
    low = float(ends[0] if smallest is None else smallest)
    high = float(ends[1] if largest is None else largest)
    span = high - low if high > low else 1.0
    scaled = np.clip((np.where(valid, values, low) - low) / span * 255, 0, 255).astype(np.uint8)
    coloured = _turbo(scaled)
    coloured[~valid] = NO_VALUE
    return np.hstack([coloured, _scale(values.shape[0], low, high)]) if bar else coloured


def colour_confidence(confidence: Floats) -> Bytes:
    """Show confidence 0..1, (H, W), from black through magenta to pale yellow."""
    scaled = np.clip(np.nan_to_num(confidence) * 255, 0, 255).astype(np.uint8)
    return _rgb(cv2.applyColorMap(scaled, cv2.COLORMAP_MAGMA))


def colour_validity(validity: Bytes, *, legend: bool = True) -> Bytes:
    """Show why pixels have no value, (H, W) bits of `Validity`; the legend, with shares, is added below."""
    classes = np.full(validity.shape, len(VALIDITY_COLOURS) - 1, np.uint8)
    for index, (bit, _) in reversed(list(enumerate(VALIDITY_COLOURS.values()))):
        if bit:
            classes[(validity & bit) != 0] = index
    named = [(name, colour) for name, (_, colour) in VALIDITY_COLOURS.items()]
    return colour_classes(classes, named, legend=legend)


def colour_classes(classes: Bytes, named: Sequence[tuple[str, Colour]], *, legend: bool = True) -> Bytes:
    """Show the class of each pixel, (H, W) index into `named`; the legend, last class first, is added below.

    The legend gives each class's share of the pixels, and leaves out what none has.
    """
    coloured = np.array([colour for _, colour in named], np.uint8)[classes]
    if not legend:
        return np.asarray(coloured)
    counts = np.bincount(classes.ravel(), minlength=len(named))
    entries = [
        (f"{name} {100 * count / classes.size:.1f} %", colour)
        for (name, colour), count in zip(named, counts, strict=True)
        if count
    ]
    return np.vstack([coloured, _legend(entries[::-1], classes.shape[1])])


def masked(picture: Picture, mask: NDArray[Any]) -> Bytes:
    """Keep the picture where the mask, (H, W), is not 0; the rest is left as a pale grey ghost.

    Raises:
        PictureError: the mask is of another size.
    """
    shown = as_rgb(picture)
    if mask.shape != shown.shape[:2]:
        raise PictureError(f"mask {mask.shape} and picture {shown.shape[:2]} differ: give them one size")
    ghost = 215 + cv2.cvtColor(shown, cv2.COLOR_RGB2GRAY)[..., None] // 10
    return np.where(mask[..., None] != 0, shown, ghost).astype(np.uint8)


def side_by_side(left: Picture, right: Picture, *, level_lines: bool = False) -> Bytes:
    """Put two pictures of one height beside each other, (H, 2 W + 8, 3).

    Args:
        left: the left picture.
        right: the right picture, of the same height.
        level_lines: draw 11 coloured lines across both: in a rectified pair each crosses the same points.

    Raises:
        PictureError: the heights differ.
    """
    if left.shape[0] != right.shape[0]:
        raise PictureError(f"heights {left.shape[0]} and {right.shape[0]} differ: give two of one height")
    gap = np.full((left.shape[0], GAP, 3), _PAPER, np.uint8)
    both = np.ascontiguousarray(np.hstack([as_rgb(left), gap, as_rgb(right)]))
    if level_lines:
        height, width = both.shape[:2]
        thickness = max(1, round(height / 300))
        for step in range(1, 12):
            y = round(step * height / 12)
            cv2.line(both, (0, y), (width - 1, y), _LINES[step % len(_LINES)], thickness)
    return both


def histogram(values: Floats, *, size: tuple[int, int] = (640, 240)) -> Bytes:
    """Draw how many pixels have which disparity, in the colours of `colour_disparity`.

    Args:
        values: px, NaN where there is none.
        size: (width, height) of the picture, at least 160 x 80 px.

    Raises:
        InputError: the size is smaller.
    """
    width, height = size
    if width < 160 or height < 80:
        raise InputError(f"a histogram of {width} x {height} px is too small: take at least 160 x 80")
    canvas = np.full((height, width, 3), _PAPER, np.uint8)
    known = values[np.isfinite(values)]
    if not known.size:
        _write(canvas, "no disparity", (width // 2, height // 2), centred=True)
        return canvas
    edge, floor = 16, height - 28
    low, high = (float(end) for end in np.percentile(known, [_OUTLIERS, 100 - _OUTLIERS]))
    low, high = (low, high) if high > low else (low - 0.5, high + 0.5)
    bins = min(96, (width - 2 * edge) // 4)
    counts, edges = np.histogram(known, bins, (low, high))
    tops = counts / max(counts.max(), 1) * (floor - 12)
    across = np.round(edge + (edges - low) / (high - low) * (width - 2 * edge)).astype(int)
    colours = _turbo(np.linspace(0, 255, bins).astype(np.uint8)[None])[0]
    for index in range(bins):
        corner = (int(across[index + 1]) - 2, floor)
        top = (int(across[index]), int(floor - round(tops[index])))
        cv2.rectangle(canvas, top, corner, tuple(int(part) for part in colours[index]), cv2.FILLED)
    cv2.line(canvas, (edge, floor), (width - edge, floor), _INK, 1)
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        x = round(edge + share * (width - 2 * edge))
        cv2.line(canvas, (x, floor), (x, floor + 4), _INK, 1)
        label = _number(low + share * (high - low), high - low) + (" px" if share == 1 else "")
        _write(canvas, label, (min(x, width - 2 * edge), height - 8), centred=True)
    return canvas


def _rgb(bgr: NDArray[Any]) -> Bytes:
    return np.ascontiguousarray(bgr[..., ::-1])


def _turbo(scaled: Bytes) -> Bytes:
    return _rgb(cv2.applyColorMap(scaled, cv2.COLORMAP_TURBO))


def _write(canvas: Bytes, text: str, at: tuple[int, int], *, centred: bool = False) -> None:
    width = cv2.getTextSize(text, _FONT, 0.4, 1)[0][0]
    left = at[0] - width // 2 if centred else at[0]
    cv2.putText(canvas, text, (left, at[1]), _FONT, 0.4, _INK, 1, cv2.LINE_AA)


def _number(value: float, span: float) -> str:
    """A number for a scale of this span: whole, or with as many decimals as tell its ends apart."""
    decimals = 0 if span >= 8 else 1 if span >= 0.8 else 2
    return f"{value:.{decimals}f}"


def _scale(height: int, low: float, high: float) -> Bytes:
    """A colour scale, (height, 64, 3), the largest disparity on top."""
    canvas = np.full((height, 64, 3), _PAPER, np.uint8)
    canvas[:, GAP : GAP + 14] = _turbo(np.linspace(255, 0, height).astype(np.uint8)[:, None])
    labels = min(5, height // 24 + 1)
    if labels == 1 or high <= low:
        return canvas
    for share in np.linspace(0, 1, labels):
        y = int(np.clip(share * height + 4, 11, height - 3))
        label = _number(high - share * (high - low), high - low) + (" px" if share == 0 else "")
        _write(canvas, label, (27, y))
    return canvas


def _legend(entries: list[tuple[str, Colour]], width: int) -> Bytes:
    """Coloured squares with words, in as many rows as the width asks for."""
    places, x, y = [], 10, 0
    for text, _ in entries:
        needed = 30 + cv2.getTextSize(text, _FONT, 0.4, 1)[0][0]
        if x > 10 and x + needed > width:
            x, y = 10, y + 22
        places.append((x, y))
        x += needed
    canvas = np.full((y + 28, width, 3), _PAPER, np.uint8)
    for (text, colour), (x, y) in zip(entries, places, strict=True):
        cv2.rectangle(canvas, (x, y + 8), (x + 11, y + 19), colour, cv2.FILLED)
        cv2.rectangle(canvas, (x, y + 8), (x + 11, y + 19), _INK, 1)
        _write(canvas, text, (x + 18, y + 18))
    return canvas
