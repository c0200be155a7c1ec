"""Bar charts of a run of the benchmark: speeds of the matchers, and ratios to OpenCV's functions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from stereo_gpu.bench.record import BenchRun
from stereo_gpu.bench.report import number
from stereo_gpu.bench.row import OPENCV

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, PALE, ROOF = "#22262b", "#d8dce2", "#5a616b"
OPENCV_COLOUR = "#9aa1ab"
COLOURS = ("#12708e", "#dd6b33", "#5b8c3a", "#8a4fa3", "#b8902b", "#3f5fb0")  # devices in turn
FASTER, SLOWER = "#2e8b6f", "#d0603f"
DPI = 130
MATCHERS = ("ncc_wta", "match fast", "match paper", "match precise")


def draw_speed(run: BenchRun) -> Figure | None:
    """How many times as fast as StereoBM each matcher is, timed in turn with it; a panel a size.

    Not GDE/s: those of two matchers are of two moments, which a busy machine makes different.
    """
    rows = [r for r in run.rows if r.to_stereobm and (r.kind == "peer" or r.name in MATCHERS)]
    sizes = [size for size in run.sizes if any(row.size == size for row in rows)]
    if not sizes:
        return None
    shades = colours(run)
    most = max(sum(row.size == size for row in rows) for size in sizes)
    figure = new_figure(4.6 * len(sizes) + 0.6, 1.9 + 0.3 * most)
    speeds = [1 / (row.to_stereobm or 1) for row in rows]
    low, high = min(0.5, *speeds) / 10, max(2.0, *speeds) * 4
    for index, size in enumerate(sizes):
        axes = figure.add_subplot(1, len(sizes), index + 1)
        shown = sorted((row for row in rows if row.size == size), key=lambda row: row.to_stereobm or 0)
        for place, row in enumerate(shown):
            speed = 1 / (row.to_stereobm or 1)
            axes.barh(place, speed - 1, left=1, color=shades[row.device], height=0.72, zorder=3)
            side, align = (speed / 1.1, "right") if speed < 1 else (speed * 1.1, "left")
            axes.text(side, place, number(speed), va="center", ha=align, fontsize=8)
        axes.axvline(1, color=INK, linewidth=1, zorder=4)
        axes.set_yticks(range(len(shown)), [row.name for row in shown])
        axes.set(xscale="log", xlim=(low, high), ylim=(most - 0.4, -0.6))
        peer = next((row.evaluations_s for row in shown if row.name == "StereoBM" and row.evaluations_s), None)
        title = "{} x {} x {}".format(*size)
        axes.set_title(f"{title}\nStereoBM: {number(peer / 1e9)} GDE/s" if peer else title, loc="left")
        axes.set_xlabel("times as fast as StereoBM (log scale)")
        dress(axes)
        plain_ticks(axes, "x")
        axes.grid(False, axis="y")
    present = [name for name in shades if any(row.device == name for row in rows)]
    _legend(figure, [(name, shades[name]) for name in present])
    figure.tight_layout(rect=(0, 0, 1, 1 - 0.32 / figure.get_figheight()))
    return figure


def draw_peers(run: BenchRun) -> Figure | None:
    """Wall time over that of the OpenCV function that does the same: bars from 1 to either side, a panel a device."""
    rows = [row for row in run.rows if row.to_peer]
    names = [name for name in dict.fromkeys(row.name for row in run.rows) if any(row.name == name for row in rows)]
    panels = [facts for facts in run.devices if any(row.device == facts.name for row in rows)]
    if not panels:
        return None
    sizes = [size for size in run.sizes if any(row.size == size for row in rows)]
    height = 0.8 / len(sizes)
    figure = new_figure(5.6 * len(panels) + 1.2, 1.8 + len(names) * (0.2 + 0.15 * len(sizes)))
    ratios = [row.to_peer or 1 for row in rows]
    low, high = min(0.5, *ratios) / 2.5, max(2.0, *ratios) * 2.5
    for index, facts in enumerate(panels):
        axes = figure.add_subplot(1, len(panels), index + 1)
        for row in rows:
            if row.device != facts.name:
                continue
            ratio, which = row.to_peer or 1, sizes.index(row.size)
            place = names.index(row.name) + (which - (len(sizes) - 1) / 2) * height
            shade = 0.45 + 0.55 * (which + 1) / len(sizes)
            colour = FASTER if ratio < 1 else SLOWER
            axes.barh(place, ratio - 1, left=1, height=height * 0.9, color=colour, alpha=shade, zorder=3)
            side, align = (ratio / 1.08, "right") if ratio < 1 else (ratio * 1.08, "left")
            axes.text(side, place, number(ratio), va="center", ha=align, fontsize=6.8)
        peers = {row.name: row.peer for row in rows}
        axes.set_yticks(range(len(names)), [f"{name}\nover {peers[name]}" for name in names], fontsize=8)
        axes.axvline(1, color=INK, linewidth=1, zorder=4)
        axes.set(xscale="log", xlim=(low, high), ylim=(len(names) - 0.4, -0.6))
        axes.set_title(facts.name, loc="left")
        axes.set_xlabel("time over that of OpenCV, both wall time (log scale); left of 1 is faster")
        dress(axes)
        plain_ticks(axes, "x")
        axes.grid(False, axis="y")
        if index:
            axes.set_yticklabels([])
    entries = [("faster than OpenCV", FASTER), ("slower", SLOWER)]
    words = ", ".join("{} x {} x {}".format(*size) for size in sizes)
    _legend(figure, entries, f"bars of each, from the top: {words}")
    figure.tight_layout(rect=(0, 0, 1, 1 - 0.32 / figure.get_figheight()))
    return figure


def colours(run: BenchRun) -> dict[str, str]:
    """A colour for each device."""
    names = [facts.name for facts in run.devices]
    return {name: COLOURS[i % len(COLOURS)] for i, name in enumerate(names)} | {OPENCV: OPENCV_COLOUR}


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of this size in inches, which no window system takes part in."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def dress(axes: Axes) -> None:
    """Grid and frame as all our panels have them."""
    axes.grid(True, which="major", color=PALE, linewidth=0.7, zorder=1)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(ROOF)
    axes.tick_params(colors=INK, which="both", length=3)


def plain_ticks(axes: Axes, which: str) -> None:
    """Numbers such as 0.01 and 100 rather than powers of ten."""
    from matplotlib.ticker import FuncFormatter, NullFormatter

    for axis in (getattr(axes, f"{name}axis") for name in which):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.10g}"))
        axis.set_minor_formatter(NullFormatter())


def _legend(figure: Figure, entries: list[tuple[str, str]], title: str = "") -> None:
    from matplotlib.patches import Patch

    handles: list[Any] = [Patch(color=colour, label=name) for name, colour in entries]
    if title:
        handles.append(Patch(color="none", label=title))
    figure.legend(handles=handles, loc="upper left", ncols=len(handles), frameon=False, fontsize=8.5)
