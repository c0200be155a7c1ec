"""Ask xatlas where to cut a mesh into charts, tile by tile in child processes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.types import Doubles, Floats, Surface
from stereo_gpu.unwrap_parts import join_small, parts, tiles
from stereo_gpu.unwrap_pool import NoAnswerError, Question, WorkerPool

_Indices = NDArray[np.integer]

# xatlas' time grows faster than the size of a connected piece.
_FACES_PER_TILE = 600
# Depth counts this much against the directions across when xatlas looks for folds. At 1 it would cut along the noise of
# depth, many times that across; at 0.005 and less it takes what is nearly flat for many planes.
_RELIEF = 0.02
# A chart under this many pixels is not worth its gutter and seam: one of 32 x 32 px needs half as many texels again.
_SMALLEST_CHART = 1000.0
# A tile takes some hundredths of a second; one that takes this long hangs.
_TILE_LIMIT_S = 5.0


def find_charts(pool: WorkerPool, surface: Surface, seen: Doubles, time_limit_s: float) -> tuple[_Indices, str | None]:
    """Find the chart of each face.

    Args:
        pool: asked for xatlas.
        surface: the mesh, all of it finite, or xatlas hangs.
        seen: (N, 2) its vertices on the view, px.
        time_limit_s: for all tiles together.

    Returns:
        (M,) the chart of each face, with gaps in the numbers. Where xatlas gave no answer for a tile, the whole tile is
        a chart, and the second result says for how many tiles, and why.

    Raises:
        NoAnswerError: there is none for any tile.
    """
    faces = surface.faces
    cut = tiles(parts(faces, len(seen)), seen[faces].mean(axis=1), _FACES_PER_TILE)
    questions = []
    for tile in cut:
        used, local = np.unique(faces[tile], return_inverse=True)
        local = local.reshape(-1, 3).astype(np.uint32)
        positions = _pressed(surface.vertices[used], seen[used], local).astype(np.float32)
        questions.append(Question("charts", {"positions": positions, "faces": local}))
    each = min(_TILE_LIMIT_S, time_limit_s / 2)
    answers = pool.ask(questions, time_limit_s=time_limit_s, question_limit_s=each)
    lost = [answer for answer in answers if isinstance(answer, NoAnswerError)]
    if len(lost) == len(cut):
        raise lost[0]
    chart = np.empty(len(faces), np.int64)
    for number, (tile, answer) in enumerate(zip(cut, answers, strict=True)):
        chart[tile] = number * len(faces) + (0 if isinstance(answer, NoAnswerError) else answer["chart"] + 1)
    area = signed_areas(seen, faces)
    joined = join_small(np.unique(chart, return_inverse=True)[1], faces, seen, np.abs(area), _SMALLEST_CHART)
    # What turns its back to the view lies over something else there, and gets a chart of its own.
    backwards = np.sign(area) * np.sign(area.sum()) < 0
    return 2 * joined + backwards, f"in {len(lost)} of {len(cut)} tiles: {lost[0]}" if lost else None


def signed_areas(seen: Doubles, faces: _Indices) -> Doubles:
    """(M,): areas of faces on the view, px; above 0 where the corners go round clockwise."""
    a, b, c = (seen[faces[:, i]].T for i in range(3))
    return np.asarray(0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])))


def _space(vertices: Floats, faces: _Indices) -> float:
    """Area of a mesh."""
    a, b, c = (vertices[faces[:, i]].astype(np.float64) for i in range(3))
    p, q = b - a, c - a
    squared = (p * p).sum(axis=1) * (q * q).sum(axis=1) - (p * q).sum(axis=1) ** 2
    return float(0.5 * np.sqrt(np.maximum(squared, 0)).sum())


def _pressed(vertices: Floats, seen: Doubles, faces: _Indices) -> Doubles:
    """(n, 3): a tile in pixels around its middle, with its depth pressed flat."""
    depth = vertices[:, 2].astype(np.float64)
    space = _space(vertices, faces)
    pixels_per_unit = math.sqrt(np.abs(signed_areas(seen, faces)).sum() / space) if space > 0 else 0.0
    tile = np.column_stack([seen, depth * (_RELIEF * pixels_per_unit)])
    return np.asarray(tile - tile.mean(axis=0))
