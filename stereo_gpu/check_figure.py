"""Draw where in the frame the rows of a pair differ, and by how much."""

from __future__ import annotations

import cv2
import numpy as np

from stereo_gpu.epipolar.error_map import smooth
from stereo_gpu.figures import Colour, as_rgb
from stereo_gpu.images import grey
from stereo_gpu.rig_check import RigCheck
from stereo_gpu.types import Bytes, Doubles, Floats, Picture

WIDE, WIDEST = 960, 1600  # px: narrower pictures are enlarged, pictures with a longer side are shrunk
LEAST_END = 0.5  # px: a good rig's noise must not look like a fault
MARGIN = 74  # px, for the scale
_PAPER: Colour = (250, 250, 250)
_INK: Colour = (40, 44, 52)
# From the right picture's features lying lower, through none, to higher.
_LOW, _NONE, _HIGH = np.array([[33, 102, 200], [245, 245, 240], [205, 40, 50]], np.float64)
_FONT = cv2.FONT_HERSHEY_SIMPLEX


def draw_check(left: Picture, checked: RigCheck) -> Bytes:
    """The left picture with every feature's vertical error, and each cell's median, in colours and px.

    Red: the right picture's features lie higher than the left one's; blue: lower. Beside it the scale, below it
    what the check says.

    Args:
        left: the raw left picture, (H, W) or (H, W, 3).
        checked: what `check_rig` found with it.
    """
    height, width = left.shape[:2]
    zoom = min(max(1.0, WIDE / width), WIDEST / max(width, height))
    size = (max(1, round(width * zoom)), max(1, round(height * zoom)))
    plain = cv2.resize(grey(left), size, interpolation=cv2.INTER_AREA if zoom < 1 else cv2.INTER_CUBIC)
    drawn = as_rgb(cv2.convertScaleAbs(plain, alpha=0.6, beta=60))
    end = max(LEAST_END, float(np.percentile(np.abs(checked.vertical), 95)) if len(checked.vertical) else 0.0)
    field = smooth(checked.map, size)
    known = np.isfinite(field)
    # By a table of so many steps, since the sum over every pixel in floating point takes ten times as long.
    steps = _coloured(np.linspace(-end, end, 256), end).round().astype(np.uint8)
    step = np.clip((np.where(known, field, 0.0) / end + 1) * 127.5 + 0.5, 0, 255).astype(np.uint8)
    blended = cv2.addWeighted(drawn, 0.45, cv2.applyColorMap(step, steps[:, None]), 0.55, 0)
    np.copyto(drawn, blended, where=known[..., None])
    for place, colour in zip(checked.points_left, _coloured(checked.vertical, end), strict=True):
        at = tuple(round(float(value)) for value in (place + 0.5) * zoom - 0.5)
        cv2.circle(drawn, at, 4, _INK, cv2.FILLED, cv2.LINE_AA)
        cv2.circle(drawn, at, 3, tuple(float(part) for part in colour), cv2.FILLED, cv2.LINE_AA)
    _write_medians(drawn, checked.map.values)
    whole = np.hstack([drawn, _scale(size[1], end)])
    words = f"{checked.says}. Colours and medians of cells: row in the left picture less row in the right one, px."
    return np.vstack([whole, _caption(words, whole.shape[1])])


def _coloured(errors: Doubles | Floats, end: float) -> Doubles:
    """(N, 3) colours of errors (N,) px on a scale from -end to end."""
    share = np.clip(np.asarray(errors, np.float64) / end, -1, 1)[..., None]
    colours: Doubles = _NONE + np.where(share > 0, share * (_HIGH - _NONE), -share * (_LOW - _NONE))
    return colours


def _write_medians(canvas: Bytes, values: Doubles) -> None:
    rows, columns = values.shape
    for row, column in np.argwhere(np.isfinite(values)).tolist():
        text = f"{values[row, column]:+.2f}"
        (wide, high), _ = cv2.getTextSize(text, _FONT, 0.5, 1)
        x = round((column + 0.5) * canvas.shape[1] / columns - wide / 2)
        y = round((row + 0.5) * canvas.shape[0] / rows + high / 2)
        cv2.rectangle(canvas, (x - 4, y - high - 4), (x + wide + 4, y + 5), _PAPER, cv2.FILLED)
        cv2.putText(canvas, text, (x, y), _FONT, 0.5, _INK, 1, cv2.LINE_AA)


def _scale(height: int, end: float) -> Bytes:
    """The colours with their numbers, (height, MARGIN, 3), errors above 0 on top."""
    canvas = np.full((height, MARGIN, 3), _PAPER, np.uint8)
    values = np.linspace(end, -end, height)
    canvas[:, 8:24] = _coloured(values, end)[:, None].round().astype(np.uint8)
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        y = int(np.clip(share * height + 4, 12, height - 4))
        value = end * (1 - 2 * share)
        cv2.putText(canvas, f"{value:+.1f}" if value else "0 px", (29, y), _FONT, 0.42, _INK, 1, cv2.LINE_AA)
    return canvas


def _caption(text: str, width: int) -> Bytes:
    """Words on paper, in as many lines as they need."""
    lines: list[str] = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if cv2.getTextSize(longer, _FONT, 0.5, 1)[0][0] > width - 24 and lines[-1]:
            lines.append(word)
        else:
            lines[-1] = longer
    canvas = np.full((22 * len(lines) + 16, width, 3), _PAPER, np.uint8)
    for number, line in enumerate(lines):
        cv2.putText(canvas, line, (12, 24 + 22 * number), _FONT, 0.5, _INK, 1, cv2.LINE_AA)
    return canvas
