"""How far each kernel is from what a device's memory and arithmetic allow (Williams, Waterman, Patterson 2009)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from stereo_gpu.bench.figures import ROOF, colours, dress, new_figure, plain_ticks
from stereo_gpu.bench.record import BenchRun
from stereo_gpu.bench.row import Row

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LETTER_WIDTH, LETTER_HEIGHT = 0.0145, 0.034  # of labels, as shares of the panel


def draw_roofline(run: BenchRun) -> Figure | None:
    """Operations a second over operations a byte, under the roofs that were measured; a panel a device."""
    size = _largest_common_size(run)
    panels = []
    for facts in run.devices:
        rows = [r for r in run.rows if r.device == facts.name and r.size == size and r.operations and r.seconds]
        if rows:
            panels.append((facts, rows))
    if not panels:
        return None
    points = {facts.name: [_point(row) for row in rows] for facts, rows in panels}
    every = [point for found in points.values() for point in found]
    # The same axes for all devices, so that panels can be compared.
    left = min(x for x, _ in every) / 3
    right = 5 * max(*(x for x, _ in every), *(facts.operations_s / facts.copy_bytes_s for facts, _ in panels))
    bottom = min(y for _, y in every) / 3
    top = 3 * max(*(y for _, y in every), *(facts.operations_s / 1e9 for facts, _ in panels))
    figure = new_figure(6.2 * len(panels), 5.4)
    for index, (facts, _) in enumerate(panels):
        axes = figure.add_subplot(1, len(panels), index + 1)
        axes.set(xscale="log", yscale="log", xlim=(left, right), ylim=(bottom, top))
        bandwidth, peak = facts.copy_bytes_s / 1e9, facts.operations_s / 1e9
        corners, roof = [left, peak / bandwidth, right], [left * bandwidth, peak, peak]
        axes.plot(corners, roof, color=ROOF, linewidth=1.8, zorder=2)
        axes.fill_between(corners, roof, bottom, color="#f3f5f7", zorder=0)
        across, up = [x for x, _ in points[facts.name]], [y for _, y in points[facts.name]]
        axes.scatter(across, up, s=34, color=colours(run)[facts.name], edgecolor="white", linewidth=0.7, zorder=4)
        what = "fused multiply-add" if facts.kind == "cpu" else "multiply, then add"
        axes.text(right / 1.1, peak * 1.12, f"{what}: {peak:,.0f} Gop/s", ha="right", color=ROOF)
        axes.set_title(f"{facts.name}\n{size[0]} x {size[1]} x {size[2]}, window {run.window}", loc="left")
        axes.set_xlabel("operations for each byte that must be moved")
        axes.set_ylabel("Gop/s")
        dress(axes)
        plain_ticks(axes, "xy")
    figure.text(
        0.01,
        0.012,
        "Operations are counted from each kernel's formula, bytes are each input and output once. Both roofs were"
        " measured in this run,\nthe sloping one on arrays larger than any cache: above it the caches hold the data."
        " Kernels whose work depends on the picture are left out.",
        fontsize=7.6,
        color=ROOF,
    )
    figure.tight_layout(rect=(0, 0.055, 1, 1))
    # What follows depends on where the panels have come to lie.
    for axes, (facts, rows) in zip(figure.axes, panels, strict=True):
        ridge = facts.operations_s / facts.copy_bytes_s
        slope = [(x, x * facts.copy_bytes_s / 1e9) for x in np.geomspace(left, ridge, 60)]
        _label_slope(axes, slope, f"copy: {facts.copy_bytes_s / 1e9:.3g} GB/s")
        named = [(x, y, row.name) for (x, y), row in zip(points[facts.name], rows, strict=True)]
        _label(axes, named, slope)
    return figure


def _point(row: Row) -> tuple[float, float]:
    operations, seconds = row.operations or 0.0, row.seconds or math.inf
    return operations / row.bytes_moved, operations / seconds / 1e9


def _largest_common_size(run: BenchRun) -> tuple[int, int, int]:
    """The largest size at which most kernels were run on every device; large ones may have been too slow."""
    counts = {}
    for size in run.sizes:
        counts[size] = sum(bool(row.operations and row.seconds) for row in run.rows if row.size == size)
    most = max(counts.values(), default=0)
    return [size for size in run.sizes if counts[size] == most][-1]


def _label_slope(axes: Axes, slope: list[tuple[float, float]], text: str) -> None:
    """Write along the lower end of a slope, just above it."""
    (x, y), (far, high) = axes.transData.transform([slope[3], slope[-1]])
    axes.annotate(
        text,
        slope[3],
        xytext=(-3, 5),
        textcoords="offset points",
        rotation=math.degrees(math.atan2(high - y, far - x)),
        rotation_mode="anchor",
        color=ROOF,
    )


def _label(axes: Axes, points: list[tuple[float, float, str]], slope: list[tuple[float, float]]) -> None:
    """Write a name beside each point, where it covers neither a point nor another name nor the roof's slope."""
    (left, right), (bottom, top) = (tuple(map(math.log10, ends)) for ends in (axes.get_xlim(), axes.get_ylim()))
    places = [
        ((math.log10(x) - left) / (right - left), (math.log10(y) - bottom) / (top - bottom), name)
        for x, y, name in points
    ]
    taken = [(x - 0.012, y - 0.016, x + 0.012, y + 0.016) for x, y, _ in places]
    line = [((math.log10(x) - left) / (right - left), (math.log10(y) - bottom) / (top - bottom)) for x, y in slope]
    taken += [(x, y, x, y) for x, y in line]
    for x, y, name in places:
        wide = LETTER_WIDTH * len(name)
        tries = [
            (x + 0.02 if to_right else x - 0.02 - wide, y + step)
            for step in (0.0, 0.035, -0.035, 0.07, -0.07, 0.105, -0.105, 0.14, -0.14)
            for to_right in (True, False)
        ]
        boxes = [(a, b - LETTER_HEIGHT / 2, a + wide, b + LETTER_HEIGHT / 2) for a, b in tries]
        free = [
            box for box in boxes if box[0] > 0.01 and box[2] < 1 and not any(_overlap(box, other) for other in taken)
        ]
        box = (free or boxes)[0]
        taken.append(box)
        middle = (box[1] + box[3]) / 2
        axes.text(box[0], middle, name, transform=axes.transAxes, va="center", fontsize=8.5, zorder=5)
        if abs(middle - y) > 0.05:
            end = box[0] if box[0] > x else box[2]
            axes.plot([x, end], [y, middle], transform=axes.transAxes, color=ROOF, linewidth=0.5, zorder=3)


def _overlap(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
