"""Give a mesh texture coordinates: charts of xatlas, or the textured view's own coordinates."""

from __future__ import annotations

import logging
import math
import time
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_gpu.errors import InputError, StageError
from stereo_gpu.types import Doubles, Floats, Ints, Surface
from stereo_gpu.unwrapping.charts import find_charts, signed_areas, tiles_of
from stereo_gpu.unwrapping.child import LateError, NoAnswerError
from stereo_gpu.unwrapping.pack import find_cells, pack
from stereo_gpu.unwrapping.parts import parts
from stereo_gpu.unwrapping.pool import shared_pool

_Indices = NDArray[np.integer]

log = logging.getLogger(__name__)

# How much of the time limit the tiles may take; the rest is for packing.
_TILES_SHARE = 0.75
# How often the atlas is made coarser until it is no larger than asked for.
_TRIES = 8
_VIEWS_OWN = "the view's own coordinates"


@dataclass(frozen=True, kw_only=True)
class Unwrapped:
    """A mesh with texture coordinates; vertices on seams stand in it once for each chart.

    Args:
        vertices: (N', 3) float32, in the surface's unit and frame.
        faces: (M, 3) int32 into `vertices`, in the order of the surface's faces.
        uv: (N', 2) float32 in 0..1, origin at the top left corner of the atlas.
        vertex_map: (N',) int32, the surface's vertex that each one is.
        size: (width, height) of the atlas, texels; one is a pixel of the view.
        method: what was used: "xatlas" or "view".
        reason: what was taken in place of that which was asked for, and why; None if all went as asked.
        charts: how many there are.
        texels_per_pixel: resolution of the atlas against the view.
    """

    vertices: Floats
    faces: Ints
    uv: Floats
    vertex_map: Ints
    size: tuple[int, int]
    method: str
    reason: str | None = None
    charts: int = 1
    texels_per_pixel: float = 1.0


def unwrap(
    surface: Surface,
    view_uv: Doubles | Floats,
    *,
    method: str = "charts",
    time_limit_s: float = 30.0,
    texels_per_pixel: float = 1.0,
    padding: int = 4,
    max_size: int = 8192,
) -> Unwrapped:
    """Lay the mesh out on a texture atlas.

    With "charts" xatlas decides where to cut, tile by tile in child processes, and packs the charts. Inside of a chart
    the coordinates are the view's own, shifted by whole texels: a chart then has as many texels as the view has pixels
    there, and baking copies the picture. With "view" the parts of the mesh that lie apart on the view are packed like
    that, or the view is taken as it is where that is smaller. Whatever goes wrong, the view's coordinates serve in its
    place, for the tile or for all: they are one-to-one wherever that camera sees the surface.

    Args:
        surface: the mesh.
        view_uv: (N, 2), where the textured view sees each vertex: column and row, px.
        method: "charts" or "view".
        time_limit_s: for all of xatlas' work.
        texels_per_pixel: resolution of the atlas against the view.
        padding: texels between charts at least, and at the atlas' edge.
        max_size: largest side of the atlas, texels; a larger one is made coarser, and the result says so.

    Raises:
        InputError: an option is out of range, or `view_uv` does not fit the surface.
        StageError: the surface has no face.
    """
    if method not in ("charts", "view"):
        raise InputError(f"unknown unwrap method {method!r}: pass 'charts' or 'view'")
    if not (
        0 < time_limit_s < math.inf
        and 0 < texels_per_pixel < math.inf
        and padding >= 0
        and max_size >= 16 + 2 * padding
    ):
        raise InputError(
            f"time_limit_s {time_limit_s}, texels_per_pixel {texels_per_pixel}, padding {padding}, max_size {max_size}"
            " are not all usable: pass numbers above 0, padding 0 or more, max_size 16 and twice the padding"
            " or more"
        )
    if view_uv.shape != (len(surface.vertices), 2) or not np.isfinite(view_uv).all():
        raise InputError(
            f"view_uv of shape {view_uv.shape} does not give {len(surface.vertices)} vertices a finite column and row"
        )
    if not len(surface.faces):
        raise StageError("cannot unwrap a mesh without faces; build the mesh again")
    deadline = time.monotonic() + time_limit_s
    seen = view_uv.astype(np.float64)
    whole = _whole_view(surface, seen, texels_per_pixel, padding, max_size)
    try:
        if method == "view":
            unwrapped = _packed_view(surface, seen, whole, padding, max_size, deadline)
        else:
            unwrapped = _charts(surface, seen, texels_per_pixel, padding, max_size, time_limit_s, deadline)
    except NoAnswerError as error:
        why = f"xatlas did not finish in {time_limit_s:g} s" if isinstance(error, LateError) else str(error)
        given = "as they are, not packed" if method == "view" else "instead of charts"
        unwrapped = replace(whole, reason=f"{_VIEWS_OWN} {given}: {why}")
    if unwrapped.texels_per_pixel < texels_per_pixel:
        coarser = f"{unwrapped.texels_per_pixel:.2g} texels a pixel, to be no larger than {max_size}"
        unwrapped = replace(unwrapped, reason=f"{unwrapped.reason}; {coarser}" if unwrapped.reason else coarser)
    if unwrapped.reason:
        log.warning("the texture uses %s", unwrapped.reason)
    return unwrapped


def warm_up(method: str, faces: int) -> None:
    """Start the processes that `unwrap` will need for about so many faces, which takes them 0.15 s beside other work.

    Raises:
        InputError: STEREO_GPU_UNWRAP_PROCESSES is no whole number above 0.
    """
    if method == "charts":
        shared_pool().warm(tiles_of(faces))


def _whole_view(surface: Surface, seen: Doubles, density: float, padding: int, max_size: int) -> Unwrapped:
    """The view as it is, around the mesh."""
    density = min(density, _fitting(seen, padding, max_size))
    low, extent = seen.min(axis=0) * density, np.ptp(seen, axis=0) * density
    # A pixel's centre is a whole number, a texel's is a half: the 0.5 lets them meet where the density is 1.
    low = np.floor(low) if (np.floor(low) + max_size - 2 * padding - 1 >= low + extent).all() else low
    size = np.ceil(seen.max(axis=0) * density - low - 1e-6).astype(int) + 2 * padding + 1
    return Unwrapped(
        vertices=surface.vertices,
        faces=surface.faces,
        uv=((seen * density - low + padding + 0.5) / size).astype(np.float32),
        vertex_map=np.arange(len(seen), dtype=np.int32),
        size=(int(size[0]), int(size[1])),
        method="view",
        texels_per_pixel=density,
    )


def _fitting(seen: Doubles, padding: int, max_size: int) -> float:
    """The density at which the whole view fits into the atlas."""
    return (max_size - 2 * padding - 1) / float(max(np.ptp(seen, axis=0).max(), 1.0))


def _packed_view(
    surface: Surface, seen: Doubles, whole: Unwrapped, padding: int, max_size: int, deadline: float
) -> Unwrapped:
    """The parts of the view that lie apart, packed; or the whole view where that is smaller."""
    density = whole.texels_per_pixel
    texels = seen * density
    cells = find_cells(texels, surface.faces, np.zeros(len(surface.faces), np.intp))
    # What touches on the view keeps its place: it needs no gutter, since the picture goes on beside it.
    mask = np.zeros(cells.extent[0, ::-1], np.uint8)
    _, column, row = cells.places()
    mask[row, column] = 1
    count, label = cv2.connectedComponents(mask, connectivity=8)
    if count == 2:  # one of them is the background
        return whole
    column, row = ((texels[surface.faces[:, 0]] - cells.corner[0]) // cells.side).astype(np.intp).T
    chart = label[row, column] - 1
    packed = pack(shared_pool(), texels, surface.faces, chart, padding, deadline - time.monotonic())
    if max(packed.size) > max_size or math.prod(packed.size) >= math.prod(whole.size):
        return whole
    of_vertex = np.zeros(len(seen), np.intp)
    of_vertex[surface.faces] = chart[:, None]
    uv = np.clip((texels + packed.offset[of_vertex] + 0.5) / packed.size, 0, 1)  # for vertices that no face uses
    return replace(whole, uv=uv.astype(np.float32), size=packed.size, charts=len(packed.offset))


def _charts(
    surface: Surface,
    seen: Doubles,
    density: float,
    padding: int,
    max_size: int,
    time_limit_s: float,
    deadline: float,
) -> Unwrapped:
    pool = shared_pool()
    chart, lost = find_charts(pool, surface, seen, _TILES_SHARE * time_limit_s)
    vertex_map, faces, chart = _cut(surface.faces, chart, len(seen))
    pixels = seen[vertex_map]
    covered = float(np.abs(signed_areas(seen, surface.faces)).sum())
    density = min(density, _largest_fitting(pixels[faces], chart, padding, max_size))
    for _ in range(_TRIES):
        texels = pixels * density
        packed = pack(pool, texels, faces, chart, padding, deadline - time.monotonic())
        if max(packed.size) <= max_size:
            break
        density *= 0.97 * max_size / max(packed.size)
    else:
        raise NoAnswerError(f"{len(packed.offset)} charts and their gutters do not fit into {max_size} texels")
    of_vertex = np.empty(len(pixels), np.intp)
    of_vertex[faces] = chart[:, None]
    size, count = packed.size, len(packed.offset)
    log.debug("%d charts in %d x %d texels, %.0f %% in use", count, *size, 100 * covered * density**2 / math.prod(size))
    return Unwrapped(
        vertices=surface.vertices[vertex_map],
        faces=faces,
        uv=((texels + packed.offset[of_vertex] + 0.5) / size).astype(np.float32),
        vertex_map=vertex_map,
        size=size,
        method="xatlas",
        reason=f"{_VIEWS_OWN} instead of charts {lost}" if lost else None,
        charts=count,
        texels_per_pixel=density,
    )


def _cut(faces: Ints, chart: _Indices, count: int) -> tuple[Ints, Ints, _Indices]:
    """Double the vertices on seams: (N',) the vertex that each one is, (M, 3) faces, (M,) charts from 0, connected."""
    key = chart[:, None] * count + faces
    keys, cut = np.unique(key, return_inverse=True)
    cut = cut.reshape(-1, 3).astype(np.int32)
    return (keys % count).astype(np.int32), cut, parts(cut, len(keys))


def _largest_fitting(corners: Doubles, chart: _Indices, padding: int, max_size: int) -> float:
    """The density at which the largest chart fits into the atlas."""
    order = np.argsort(chart, kind="stable")
    first = np.append(0, np.flatnonzero(np.diff(chart[order])) + 1)
    low = np.minimum.reduceat(corners.min(axis=1)[order], first)
    high = np.maximum.reduceat(corners.max(axis=1)[order], first)
    room = max_size - 2 * (padding + 8)
    return max(room, 1) / float(max((high - low).max(), 1.0))
