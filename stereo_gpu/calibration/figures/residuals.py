"""What the calibration leaves unexplained: residuals of all views pooled, and what they have in common by place."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from stereo_gpu.calibration.figures.svg import WIDTH, Frame, Plot, dots, needles, path, round_number, thinned, words
from stereo_gpu.calibration.outcome import Calibration, CalibrationView
from stereo_gpu.types import Doubles

MOST_DOTS = 2500  # in a scatter
RANGE = 99.0  # percent of the residuals that a scatter's frame holds; the rest are drawn on its edge
FIELD = (8, 6)  # cells of the field, columns and rows
FEWEST = 8  # residuals, below which a cell's mean is mostly noise and is not drawn
LONGEST = 0.5  # of a cell: how long the arrows of a field come,
TYPICAL = 85.0  # all but the longest: percent of them; cells with few corners at the edge would set the scale


@dataclass(frozen=True)
class Residuals:
    """Corners as seen, less where the model puts them.

    Args:
        model: (N, 2) px, where the model puts the corners.
        off: (N, 2) px, how much further right and down they were seen.
    """

    model: Doubles
    off: Doubles

    @property
    def rms(self) -> float:
        """Root of the mean squared distance, px; 0 of nothing."""
        return float(np.sqrt((self.off**2).sum(axis=1).mean())) if len(self.off) else 0.0


def view_residuals(view: CalibrationView, side: int) -> Residuals | None:
    """Of one picture; None where no board was found in it or the model puts none."""
    seen, projected = view.seen[side], view.projected[side]
    if seen is None or projected is None:
        return None
    model = np.asarray(projected, np.float64).reshape(-1, 2)
    off = np.asarray(seen, np.float64).reshape(-1, 2) - model
    finite = np.isfinite(off).all(axis=1)
    return Residuals(model[finite], off[finite])


def pooled_residuals(calibration: Calibration, side: int) -> Residuals:
    """Of all pictures of one camera that count."""
    found = [one for view in calibration.views if view.used and (one := view_residuals(view, side)) is not None]
    parts = [(one.model, one.off) for one in found] or [(np.zeros((0, 2)), np.zeros((0, 2)))]
    model, off = (np.concatenate(each) for each in zip(*parts, strict=True))
    return Residuals(model, off)


def scatter_reach(both: Iterable[Residuals]) -> float:
    """How far from zero, px, the scatters of both cameras reach, so that one can be held against the other."""
    reach = max([1e-3, *(float(np.percentile(np.abs(one.off), RANGE)) * 1.25 for one in both if len(one.off))])
    step = round_number(reach / 3)
    return float(step * np.ceil(reach / step))


def draw_scatter(residuals: Residuals, side: str, reach: float) -> tuple[str, str]:
    """Residuals in px, each a dot, and their 1 sigma ellipse; returns the drawing and its caption."""
    off = residuals.off
    if len(off) < 3:
        return "", f"{len(off)} residuals are too few to draw."
    plot = Plot(x=(-reach, reach), y=(reach, -reach), size=(WIDTH, WIDTH))
    shown = off[thinned(len(off), MOST_DOTS)]
    outside = int((np.abs(off) > reach).any(axis=1).sum())
    mean, covariance = off.mean(axis=0), np.cov(off.T)
    angles = np.linspace(0, 2 * np.pi, 73)
    values, vectors = np.linalg.eigh(covariance)
    ellipse = mean + (np.column_stack([np.cos(angles), np.sin(angles)]) * np.sqrt(np.maximum(values, 0))) @ vectors.T
    drawing = plot.drawing(
        [
            *plot.axes("right, px", "down, px"),
            dots(plot.place(np.clip(shown, -reach, reach)), f"residual {side}"),
            path(plot.place(ellipse), "ellipse", close=True),
        ],
        label=f"Residuals of the {side} camera with their 1 sigma ellipse",
    )
    sigma = np.sqrt(np.diag(covariance))
    told = (
        f"{len(off):,} corners, 1 σ of {sigma[0]:.3f} px across and {sigma[1]:.3f} px down,"
        f" mean ({_zero(mean[0]):.3f}, {_zero(mean[1]):.3f}) px."
    )
    if len(shown) < len(off):
        told += f" {len(shown):,} of them drawn."
    if outside:
        told += f" {outside} beyond the frame, drawn on its edge."
    return drawing, told


def _zero(value: float) -> float:
    """The value to three digits, without the sign of a zero."""
    return round(float(value), 3) + 0.0


def draw_field(residuals: Residuals, size: tuple[int, int], side: str) -> tuple[str, str]:
    """The mean residual in each part of the picture; what is no noise there, the lens model misses."""
    frame = Frame(size)
    columns, rows = FIELD
    at = np.floor((residuals.model + 0.5) / np.array(size) * FIELD).astype(int)
    inside = ((at >= 0) & (at < FIELD)).all(axis=1)
    cell = np.where(inside, at[:, 1] * columns + at[:, 0], columns * rows)
    counts = np.bincount(cell, minlength=columns * rows + 1)[:-1]
    sums = [np.bincount(cell, weights=off, minlength=columns * rows + 1)[:-1] for off in residuals.off.T]
    enough = counts >= FEWEST
    if not enough.any():
        return "", f"No part of the picture has {FEWEST} corners."
    means = np.column_stack(sums)[enough] / counts[enough, None]
    longest = float(np.linalg.norm(means, axis=1).max())
    numbers = np.flatnonzero(enough)
    middles = (np.column_stack([numbers % columns, numbers // columns]) + 0.5) * (np.array(size) / FIELD) - 0.5
    typical = float(np.percentile(np.linalg.norm(means, axis=1), TYPICAL))
    factor = arrow_factor(typical, LONGEST * min(size[0] / columns, size[1] / rows))
    starts, ends = frame.place(middles), frame.place(middles + factor * means)
    few = ~enough
    numbers = np.flatnonzero(few)
    blank = (np.column_stack([numbers % columns, numbers // columns]) + 0.5) * (np.array(size) / FIELD) - 0.5
    drawing = frame.drawing(
        [
            dots(frame.place(blank), "blank"),
            dots(starts, f"root {side}"),
            needles(starts, ends, f"needle {side}", thick=4.0),
        ],
        label=f"Mean residuals over the {side} picture",
    )
    return drawing, (
        f"Arrows are {arrow_words(factor)}; the longest is {longest:.3f} px."
        f"{f' Grey dots: fewer than {FEWEST} corners.' if few.any() else ''}"
    )


def arrow_factor(longest: float, wanted: float) -> float:
    """A round factor that makes an arrow of `longest` px at most `wanted` px long."""
    if not longest > 0:
        return 1.0
    factor = round_number(wanted / longest)
    while factor * longest > 1.001 * wanted:
        factor = round_number(factor / 2)
    return factor


def arrow_words(factor: float) -> str:
    """How long arrows are drawn."""
    return "drawn in true length" if factor == 1 else f"drawn {factor:g} times as long as they are"


def scale_bar(frame: Frame, factor: float, css: str) -> list[str]:
    """A bar in the lower left corner that says how long an arrow of so many px is."""
    length = round_number(0.12 * frame.width / (factor * frame.scale))
    y, units = frame.height - 8, length * factor * frame.scale
    return [
        path(np.array([[8, y], [8 + units, y]]), f"bar-line {css}"),
        words(12 + units, y + 3.5, f"{length:g} px", "tick"),
    ]
