"""Draw accuracy against time: a point for each matcher."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from stereo_gpu.bench.figures import COLOURS, OPENCV_COLOUR, dress, new_figure, plain_ticks
from stereo_gpu.bench.plot import FONT
from stereo_gpu.evaluation.accuracy import PairResults
from stereo_gpu.evaluation.accuracy_tables import bad
from stereo_gpu.evaluation.cost import Cost
from stereo_gpu.evaluation.matchers import YARDSTICK, Matcher

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHAPES = "sPvD^X*<>h"  # of OpenCV's matchers, which have one colour


def draw_trade(
    costs: Mapping[str, Mapping[str, Cost]], measured: Mapping[str, PairResults], matchers: Sequence[Matcher]
) -> bytes:
    """A PNG with a panel for each pair that was timed and has a truth.

    Args:
        costs: by input, then by matcher.
        measured: by input.
        matchers: what to draw, at most ten of OpenCV's and six of ours.
    """
    import matplotlib as mpl

    panels = [name for name in costs if name in measured]
    with mpl.rc_context(FONT):
        figure = new_figure(3.9 * len(panels) + 0.3, 4.1)
        for number, name in enumerate(panels):
            axes = figure.add_subplot(1, len(panels), number + 1)
            _panel(axes, costs[name], measured[name], matchers)
            axes.set_title(name.capitalize(), loc="left")
            if not number:
                axes.set_ylabel("bad-1.0, % (no value = bad)")
        labels = figure.axes[0].get_legend_handles_labels()
        figure.legend(*labels, loc="upper left", ncols=5, frameon=False, fontsize=8.5)
        figure.tight_layout(rect=(0, 0, 1, 1 - 0.55 / figure.get_figheight()))
        held = io.BytesIO()
        figure.savefig(held, format="png", metadata={"Software": "stereo-gpu"})
    return held.getvalue()


def _panel(axes: Axes, costs: Mapping[str, Cost], measured: PairResults, matchers: Sequence[Matcher]) -> None:
    colours, shapes = iter(COLOURS), iter(SHAPES)
    for matcher in matchers:
        axes.plot(
            costs[matcher.name].wall,
            100 * bad(measured, matcher.name),
            marker="o" if matcher.ours else next(shapes),
            color=next(colours) if matcher.ours else OPENCV_COLOUR,
            linestyle="none",
            markersize=8,
            label=matcher.name.replace("`", ""),
            zorder=3 if matcher.ours else 2,
        )
    axes.axvline(1, color=OPENCV_COLOUR, linewidth=0.8, zorder=1)
    axes.set(xscale="log", ylim=(0, None))
    axes.margins(x=0.1)
    axes.set_xlabel(f"time over that of {YARDSTICK} (log scale)")
    dress(axes)
    plain_ticks(axes, "x")
