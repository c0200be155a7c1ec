"""Small pieces of SVG: paths, dots, needles, words and axes, as text.

Colours come from classes of the page's style sheet, so that one drawing serves light and dark pages. Coordinates have
one decimal, and nothing that is not finite is ever written.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from stereo_gpu.types import Doubles, Floats

WIDTH = 420.0  # units across a drawing; about as many px as it has on a page, so that words keep their size


def drawing(size: tuple[float, float], parts: Iterable[str], *, label: str, css: str = "") -> str:
    """An <svg> of `size` (width, height) units; `label` says what it shows to those who cannot see it."""
    width, height = (round(side, 1) for side in size)
    kind = f' class="{css}"' if css else ""
    return (
        f'<svg viewBox="0 0 {width:g} {height:g}"{kind} role="img" aria-label="{escape(label)}">{"".join(parts)}</svg>'
    )


def path(points: Doubles | Floats, css: str, *, close: bool = False) -> str:
    """A line through points (N, 2), closed or not."""
    points = _finite(points)
    if len(points) < 2:
        return ""
    steps = "L".join(f"{_number(x)} {_number(y)}" for x, y in points)
    return f'<path class="{css}" d="M{steps}{"z" if close else ""}"/>'


def segments(starts: Doubles | Floats, ends: Doubles | Floats, css: str) -> str:
    """Straight lines from starts to ends, (N, 2) each, as one path."""
    both = _finite(np.asarray(np.hstack([starts, ends]), np.float64))
    steps = "".join(f"M{_number(a)} {_number(b)}L{_number(c)} {_number(d)}" for a, b, c, d in both)
    return f'<path class="{css}" d="{steps}"/>' if steps else ""


def needles(starts: Doubles | Floats, ends: Doubles | Floats, css: str, *, thick: float = 2.2) -> str:
    """Arrows from starts to ends, (N, 2) each: thin triangles, broad where they start, and one path in all."""
    both = _finite(np.asarray(np.hstack([starts, ends]), np.float64))
    along = both[:, 2:] - both[:, :2]
    lengths = np.linalg.norm(along, axis=1, keepdims=True)
    both, along, lengths = (part[lengths[:, 0] > 0.05] for part in (both, along, lengths))
    across = along[:, ::-1] * (-1, 1) / lengths * np.minimum(thick, 0.35 * lengths) / 2
    steps = "".join(
        f"M{_number(x - u)} {_number(y - v)}L{_number(c)} {_number(d)}L{_number(x + u)} {_number(y + v)}z"
        for (x, y, c, d), (u, v) in zip(both.tolist(), across.tolist(), strict=True)
    )
    return f'<path class="{css}" d="{steps}"/>' if steps else ""


def dots(points: Doubles | Floats, css: str) -> str:
    """Dots at points (N, 2), as one path of lines without length; the style sheet says how thick."""
    steps = "".join(f"M{_number(x)} {_number(y)}h0" for x, y in _finite(points))
    return f'<path class="dots {css}" d="{steps}"/>' if steps else ""


def words(x: float, y: float, text: str, css: str = "", *, anchor: str = "start") -> str:
    """A line of text that starts, ends or has its middle at (x, y)."""
    place = "" if anchor == "start" else f' text-anchor="{anchor}"'
    kind = f' class="{css}"' if css else ""
    return f'<text x="{_number(x)}" y="{_number(y)}"{kind}{place}>{escape(text)}</text>'


def rectangle(corner: tuple[float, float], size: tuple[float, float], css: str, *, opacity: float = 1.0) -> str:
    """A rectangle with its upper left corner and its size in units."""
    (x, y), (width, height) = corner, size
    seen = "" if opacity == 1 else f' opacity="{opacity:.2f}"'
    return (
        f'<rect class="{css}" x="{_number(x)}" y="{_number(y)}" width="{_number(width)}"'
        f' height="{_number(height)}"{seen}/>'
    )


@dataclass(frozen=True)
class Frame:
    """A camera's picture, shrunk or enlarged to a drawing `width` units wide.

    Args:
        size: of the picture, width and height in px.
        width: of the drawing, units.
    """

    size: tuple[int, int]
    width: float = WIDTH

    @property
    def scale(self) -> float:
        """Units a pixel."""
        return self.width / self.size[0]

    @property
    def height(self) -> float:
        """Of the drawing, units."""
        return self.size[1] * self.scale

    def place(self, pixels: Doubles | Floats) -> Doubles:
        """Pixels (N, 2), centres at whole numbers, as places in the drawing."""
        return np.asarray((np.asarray(pixels, np.float64).reshape(-1, 2) + 0.5) * self.scale)

    def drawing(self, parts: Iterable[str], *, label: str) -> str:
        """An <svg> of the picture's shape with its edge drawn; what reaches over the edge is cut off."""
        size = (self.width, self.height)
        ground, edge = (rectangle((0, 0), size, css) for css in ("ground", "edge"))
        return drawing(size, [ground, *parts, edge], label=label, css="frame")


@dataclass(frozen=True)
class Plot:
    """A plot with two axes, drawn within margins for its words.

    Args:
        x, y: the ranges shown, lower end first.
        size: of the drawing, units.
    """

    x: tuple[float, float]
    y: tuple[float, float]
    size: tuple[float, float]
    margins: tuple[float, float, float, float] = (46.0, 10.0, 10.0, 36.0)  # left, top, right, bottom

    def place(self, points: Doubles) -> Doubles:
        """Points (N, 2) as places in the drawing."""
        left, top, right, bottom = self.margins
        across = (points[:, 0] - self.x[0]) / (self.x[1] - self.x[0])
        up = (points[:, 1] - self.y[0]) / (self.y[1] - self.y[0])
        return np.column_stack(
            [left + across * (self.size[0] - left - right), self.size[1] - bottom - up * (self.size[1] - top - bottom)]
        )

    def drawing(self, parts: Iterable[str], *, label: str) -> str:
        """An <svg> of the plot."""
        return drawing(self.size, parts, label=label, css="plot")

    def axes(self, x_words: str, y_words: str) -> list[str]:
        """Lines of the grid, numbers at them, and what each axis shows."""
        parts = []
        (low_x, low_y), (high_x, high_y) = self.place(np.array([[self.x[0], self.y[0]], [self.x[1], self.y[1]]]))
        for value in ticks(min(self.x), max(self.x)):
            [(x, _)] = self.place(np.array([[value, self.y[0]]]))
            parts.append(path(np.array([[x, low_y], [x, high_y]]), "zero" if value == 0 else "grid"))
            parts.append(words(x, low_y + 15, f"{value:g}", "tick", anchor="middle"))
        for value in ticks(min(self.y), max(self.y)):
            [(_, y)] = self.place(np.array([[self.x[0], value]]))
            parts.append(path(np.array([[low_x, y], [high_x, y]]), "zero" if value == 0 else "grid"))
            parts.append(words(low_x - 5, y + 4, f"{value:g}", "tick", anchor="end"))
        parts.append(words((low_x + high_x) / 2, self.size[1] - 5, x_words, "axis", anchor="middle"))
        parts.append(
            f'<g transform="translate(12 {(low_y + high_y) / 2:.1f}) rotate(-90)">'
            f"{words(0, 0, y_words, 'axis', anchor='middle')}</g>"
        )
        return parts


def ticks(low: float, high: float, about: int = 6) -> list[float]:
    """Round numbers from low to high, `about` as many as told."""
    step = round_number((high - low) / about)
    first = math.ceil(low / step - 1e-9)
    return [round(number * step, 12) + 0.0 for number in range(first, math.floor(high / step + 1e-9) + 1)]


def round_number(value: float) -> float:
    """The number of 1, 2, 5, 10, 20, ... nearest to a value above zero, by ratio."""
    power = 10.0 ** math.floor(math.log10(value))
    return min((power * digit for digit in (1, 2, 5, 10)), key=lambda choice: abs(math.log(choice / value)))


def thinned(count: int, most: int) -> Sequence[int]:
    """Numbers of at most `most` of `count` things, evenly spread: all of them where there are so few."""
    return range(count) if count <= most else np.unique(np.linspace(0, count - 1, most).astype(int)).tolist()


def _finite(points: Doubles | Floats) -> Doubles:
    kept = np.asarray(points, np.float64)
    return np.asarray(kept[np.isfinite(kept).all(axis=1)])


def _number(value: float) -> str:
    """One decimal, without a zero that says nothing."""
    text = f"{value:.1f}".removesuffix(".0")
    return "0" if text == "-0" else text
