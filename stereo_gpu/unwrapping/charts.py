"""Ask xatlas where to cut a mesh into charts, tile by tile in child processes.

xatlas is given the mesh flat, as the view sees it: it tells what hangs together and where the mesh folds over in the
view. The folds in depth it need not know, since charts keep the view's coordinates, which have a texel for every pixel
on either side of them. Shown a tenth of the depth, it takes 20 times as long, and what it cuts along is mostly noise.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.types import Doubles, Surface
from stereo_gpu.unwrapping.child import NoAnswerError, Question
from stereo_gpu.unwrapping.parts import join_small, parts, tiles
from stereo_gpu.unwrapping.pool import WorkerPool

_Indices = NDArray[np.integer]

# At 20,000 triangles tiles of 600 to 25,000 take the same time, 30 ms: fewer mean fewer seams, more use more cores.
_FACES_PER_TILE = 25_000
# A chart under this many pixels is not worth its gutter and seam: one of 32 x 32 px needs half as many texels again.
_SMALLEST_CHART = 1000.0
# A tile takes some hundredths of a second; one that takes this long hangs.
_TILE_LIMIT_S = 5.0


def tiles_of(faces: int) -> int:
    """Into about how many tiles so many faces are cut."""
    return max(1, -(-faces // _FACES_PER_TILE))


def find_charts(pool: WorkerPool, surface: Surface, seen: Doubles, time_limit_s: float) -> tuple[_Indices, str | None]:
    """Find the chart of each face.

    Args:
        pool: asked for xatlas.
        surface: the mesh.
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
        positions = np.zeros((len(used), 3), np.float32)
        positions[:, :2] = seen[used] - seen[used].mean(axis=0)
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
