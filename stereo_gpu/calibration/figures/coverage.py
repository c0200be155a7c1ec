"""Which parts of both cameras' pictures the corners of the boards cover, and what is missing."""

from __future__ import annotations

from html import escape

import numpy as np

from stereo_gpu.boards.board import BoardView
from stereo_gpu.boards.coverage import REGIONS, Coverage, missing_in_both, out_of_reach
from stereo_gpu.calibration.figures.svg import Frame, dots, rectangle, thinned, words
from stereo_gpu.calibration.outcome import Calibration
from stereo_gpu.types import Doubles, Ints

MOST_CORNERS = 4000  # drawn in a picture


def measure_coverage(calibration: Calibration) -> tuple[Coverage, Coverage]:
    """What the views that count cover of the left and of the right camera's picture."""
    return _coverage(calibration, 0), _coverage(calibration, 1)


def _coverage(calibration: Calibration, side: int) -> Coverage:
    camera = (calibration.rig.left, calibration.rig.right)[side]
    coverage = Coverage(camera.size, calibration.board)
    for view in calibration.views:
        seen, ids = view.seen[side], view.ids[side]
        if view.used and seen is not None:
            corners = np.asarray(seen, np.float32).reshape(-1, 2)
            coverage.add(BoardView.whole(corners) if ids is None else BoardView(corners, ids))
    return coverage


def draw_coverage(calibration: Calibration, side: int, both: tuple[Coverage, Coverage]) -> tuple[str, str]:
    """Cells the darker the more views have a corner in them, with the corners; returns drawing and caption (HTML)."""
    name, coverage = ("left", "right")[side], both[side]
    frame = Frame(coverage.size)
    corners = _corners(calibration, side)
    kept = corners[thinned(len(corners), MOST_CORNERS)]
    drawing = frame.drawing(
        [
            *_cells(frame, coverage.cells, name, out_of_reach(*both)[side]),
            dots(frame.place(kept), f"corner {name}"),
            *_counts(frame, coverage.cells),
        ],
        label=f"Coverage of the {name} picture",
    )
    told = f"{100 * coverage.share:.0f} % of the cells have a corner; the numbers count views."
    tilts = ", ".join(sorted(str(tilt) for tilt in coverage.tilts))
    if tilts:
        told += f" Tilts seen: {tilts}."
    if len(kept) < len(corners):
        told += f" {len(kept):,} of {len(corners):,} corners drawn."
    lacks = missing_in_both(*both)[side]
    listed = "".join(f"<li>{escape(lack)}</li>" for lack in lacks)
    return drawing, escape(told) + (
        f'<ul class="lacks">{listed}</ul>' if lacks else ' <span class="fine">Nothing is missing.</span>'
    )


def _corners(calibration: Calibration, side: int) -> Doubles:
    found = [view.seen[side] for view in calibration.views if view.used]
    return np.concatenate(
        [np.zeros((0, 2)), *(np.asarray(seen, np.float64).reshape(-1, 2) for seen in found if seen is not None)]
    )


def _cells(frame: Frame, cells: Ints, name: str, excused: frozenset[str]) -> list[str]:
    rows, columns = cells.shape
    wide, high = frame.width / columns, frame.height / rows
    most = max(1, int(cells.max()))
    wanted = np.ones(cells.shape, bool)
    for region, down, across in REGIONS:
        wanted[down, across] = region not in excused
    parts = []
    for row in range(rows):
        for column in range(columns):
            count = int(cells[row, column])
            corner = (column * wide, row * high)
            if count:
                # The root keeps a cell with one view apart from an empty one even where others have hundreds.
                parts.append(
                    rectangle(corner, (wide, high), f"cell {name}", opacity=0.12 + 0.5 * (count / most) ** 0.5)
                )
            else:
                parts.append(rectangle(corner, (wide, high), "cell empty" if wanted[row, column] else "cell away"))
    return parts


def _counts(frame: Frame, cells: Ints) -> list[str]:
    rows, columns = cells.shape
    wide, high = frame.width / columns, frame.height / rows
    return [
        words(column * wide + 4, row * high + 12, str(cells[row, column]), "count")
        for row in range(rows)
        for column in range(columns)
    ]
