"""Place charts in one atlas, shifted by whole cells of four texels: xatlas packs those that they touch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.types import Doubles, Ints
from stereo_gpu.unwrapping.child import NoAnswerError, Question
from stereo_gpu.unwrapping.pool import WorkerPool

_Indices = NDArray[np.integer]

# Side of a cell, texels: as coarse as the gutter, so that little is lost, and a sixteenth of the work. A texel of the
# second mip level is a cell, and belongs to one chart.
_CELL = 4
# With more cells than these they are made larger: packing takes as long as there are cells, times charts.
_MOST_CELLS = 40_000


@dataclass(frozen=True)
class Packed:
    """Where charts lie in the atlas.

    Args:
        offset: (C, 2) whole texels to add to a chart's texel coordinates.
        size: (width, height) of the atlas, texels.
    """

    offset: NDArray[np.int64]
    size: tuple[int, int]


@dataclass(frozen=True)
class Cells:
    """The cells that charts touch, each chart in a rectangle of its own whose corner is a whole texel.

    Args:
        side: of a cell, texels.
        corner: (C, 2) int64, the texel at which a chart's first cell begins.
        extent: (C, 2) int64, columns and rows of cells.
        base: (C + 1,) int64, where each chart's rectangle begins among all of them, row after row, with an empty column
            and row at its end.
        touched: (K,) int64, the touched cells in this order.
    """

    side: int
    corner: NDArray[np.int64]
    extent: NDArray[np.int64]
    base: NDArray[np.int64]
    touched: NDArray[np.int64]

    def places(self) -> tuple[_Indices, _Indices, _Indices]:
        """(K,) each: the chart, column and row of the touched cells."""
        chart = np.searchsorted(self.base, self.touched, side="right") - 1
        row, column = np.divmod(self.touched - self.base[chart], self.extent[chart, 0] + 1)
        return chart, column, row


def find_cells(texels: Doubles, faces: Ints, chart: _Indices, padding: int = 0) -> Cells:
    """Find the cells that charts touch.

    Args:
        texels: (N, 2) of the vertices, each in one chart alone; the centre of a texel is a whole number.
        faces: (M, 3).
        chart: (M,) the chart of each face, every number from 0 up in use.
        padding: texels to keep between charts: if more than a cell, cells to the right and below count as touched.
    """
    a, b, c = (texels[faces[:, i]] for i in range(3))
    side = _side(a, b, c)
    grow = _gutter(padding, side) - 1
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    order = np.argsort(chart, kind="stable")
    first = np.append(0, np.flatnonzero(np.diff(chart[order])) + 1)
    # Whole cells, so that the first two levels of a mip map average the same texels in every chart, and fit at seams.
    corner = _CELL * np.floor(np.minimum.reduceat(low[order], first) / _CELL).astype(np.int64)
    origin = corner[chart]
    c0 = ((low - origin) // side).astype(np.int64)
    c1 = ((high - origin) // side).astype(np.int64) + grow
    extent = np.maximum.reduceat(c1[order], first) + 1
    stride = extent[:, 0] + 1
    base = np.append(0, np.cumsum(stride * (extent[:, 1] + 1)))
    columns, rows = (c1 - c0 + 1).T
    # Row by row: of a sliver that lies askew the rectangle around it would have far too many cells.
    face = np.repeat(np.arange(len(faces)), rows)
    row = _counted(rows) + c0[face, 1]
    begin, end = c0[face, 0], c1[face, 0]
    # Of a triangle that spans no more than two cells either way, the cells of its rectangle will do.
    doubtful = np.flatnonzero((np.minimum(columns, rows) > 2 + grow)[face])
    of = face[doubtful]
    left, right = _span(
        [(point[of] - origin[of]) / side for point in (a, b, c)], row[doubtful] - grow, row[doubtful] + 1
    )
    # Where rounding leaves nothing of a triangle in a row, left is beyond right.
    begin[doubtful] = np.clip(left, begin[doubtful], end[doubtful] + 1)
    end[doubtful] = np.clip(np.floor(right) + grow, begin[doubtful] - 1, end[doubtful])
    count = end - begin + 1
    start = base[chart[face]] + row * stride[chart[face]] + begin
    mask = np.zeros(base[-1], bool)
    mask[np.repeat(start, count) + _counted(count)] = True
    return Cells(side=side, corner=corner, extent=extent, base=base, touched=np.flatnonzero(mask))


def _side(a: Doubles, b: Doubles, c: Doubles) -> int:
    """The side of a cell for triangles of these corners."""
    p, q = b - a, c - a
    area = 0.5 * float(np.abs(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum())
    side = _CELL
    while area > _MOST_CELLS * side**2:
        side *= 2
    return side


def _gutter(padding: int, side: int) -> int:
    """How many cells keep charts so many texels apart."""
    return max(-(-padding // side), 1)


def _counted(counts: _Indices) -> _Indices:
    """0, 1, 2 ... up to each count in turn."""
    return np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)


def _span(corners: Sequence[Doubles], top: _Indices, bottom: _Indices) -> tuple[Doubles, Doubles]:
    """(K,) each: from where to where triangles reach between two heights; from infinity where they do not."""
    left, right = np.full(len(top), np.inf), np.full(len(top), -np.inf)
    for i in range(3):
        (x, y), (to_x, to_y) = corners[i].T, corners[(i + 1) % 3].T
        within = (np.maximum(y, to_y) >= top) & (np.minimum(y, to_y) <= bottom)
        slope = (to_x - x) / np.where(to_y == y, np.inf, to_y - y)
        for height in (y, to_y):
            met = x + slope * (np.clip(height, top, bottom) - y)
            left = np.where(within, np.minimum(left, met), left)
            right = np.where(within, np.maximum(right, met), right)
    return left, right


def pack(pool: WorkerPool, texels: Doubles, faces: Ints, chart: _Indices, padding: int, time_limit_s: float) -> Packed:
    """Place charts in one atlas.

    xatlas moves the first texel's centre of every chart to half a cell, so that a chart touches one cell more to the
    right and below: that is the gutter, and no chart can have another in any of the eight cells around its own.

    Args:
        pool: asked for xatlas.
        texels, faces, chart: see `find_cells`; the faces of a chart hang together by vertices.
        padding: texels between charts, and at the atlas' edge.
        time_limit_s: for xatlas.

    Raises:
        NoAnswerError: xatlas did not pack them.
    """
    cells = find_cells(texels, faces, chart, padding)
    corners, rectangles, first = _rectangles(cells)
    arrays = {"corners": corners.astype(np.float32), "faces": rectangles.astype(np.uint32), "first": first}
    (answer,) = pool.ask([Question("pack", arrays)], time_limit_s=time_limit_s)
    if isinstance(answer, NoAnswerError):
        raise answer
    # `first` is the left end of the top row.
    moved = np.rint(answer["place"] - 0.5 - corners[first]).astype(np.int64)
    columns, rows = (int(side) for side in answer["size"])
    of, column, row = cells.places()
    x, y = column + _canvas(cells)[of] + moved[of, 0], row + moved[of, 1]
    inside = (x >= 0) & (x < columns) & (y >= 0) & (y < rows)
    if not inside.all() or np.bincount(y * columns + x).max() > 1:
        raise NoAnswerError("xatlas put charts on top of each other")
    margin = cells.side * _gutter(padding, cells.side) if padding else 0
    shift = np.column_stack([moved[:, 0] + _canvas(cells), moved[:, 1]])
    return Packed(
        offset=shift * cells.side + margin - cells.corner,
        size=(columns * cells.side + margin, rows * cells.side + margin),
    )


def _canvas(cells: Cells) -> NDArray[np.int64]:
    """(C,): the column at which each chart begins where all lie side by side."""
    width = cells.extent[:, 0] + 2
    return np.asarray(np.cumsum(width) - width)


def _rectangles(cells: Cells) -> tuple[_Indices, _Indices, _Indices]:
    """The charts as xatlas takes them: corners (4 R, 2), faces (F, 3), and (C,) a corner in the first row of each.

    Each run of cells along a row is a rectangle. To xatlas a chart is what hangs together by corners, so wherever a
    run lies above another a triangle inside of one of them ties both together.
    """
    touched = cells.touched
    gap = np.flatnonzero(np.diff(touched) != 1)
    start, end = touched[np.append(0, gap + 1)], touched[np.append(gap, len(touched) - 1)] + 1
    chart = np.searchsorted(cells.base, start, side="right") - 1
    stride = cells.extent[chart, 0] + 1
    row, left = np.divmod(start - cells.base[chart], stride)
    left += _canvas(cells)[chart]
    right = left + end - start
    corners = np.stack([left, row, right, row, right, row + 1, left, row + 1], axis=1).reshape(-1, 2)
    # All runs of the next row that lie under a run follow each other; the last row has an empty one below.
    under = np.searchsorted(end, start + stride, side="right")
    count = np.searchsorted(start, end + stride, side="left") - under
    upper = np.repeat(np.arange(len(start)), count)
    lower = np.repeat(under - (np.cumsum(count) - count), count) + np.arange(len(upper))
    ties = np.where(
        (left[lower] >= left[upper])[:, None],
        np.stack([4 * upper, 4 * upper + 1, 4 * lower], axis=1),
        np.stack([4 * lower + 3, 4 * lower + 2, 4 * upper + 3], axis=1),
    )
    own = 4 * np.arange(len(start))[:, None]
    faces = np.concatenate([own + np.array([0, 1, 2]), own + np.array([0, 2, 3]), ties])
    first = 4 * np.searchsorted(chart, np.arange(len(cells.corner)))
    return corners, faces, first
