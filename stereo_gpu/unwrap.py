"""Give a mesh texture coordinates: charts of xatlas, or the textured view's own coordinates."""

from __future__ import annotations

import io
import logging
import math
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.errors import InputError, StageError
from stereo_gpu.types import Doubles, Floats, Ints, Surface

_Indices = NDArray[np.integer]

log = logging.getLogger(__name__)

_WORKER = Path(__file__).with_name("unwrap_worker.py")
# xatlas' time grows faster than the size of a connected piece: 50,000 faces take a minute whole, 2 s in tiles.
_FACES_PER_TILE = 1500
# Depth counts this much against the directions across. The texture is sampled from the view, so the atlas should
# keep the view's measure; at 1, the noise of depth breaks Motorcycle into 1,457 charts instead of 512.
_RELIEF = 0.1
# Charts, their padding and the gaps between them need about this many times the charts' own area.
_PACKING = 2.5


@dataclass(frozen=True, kw_only=True)
class Unwrapped:
    """A mesh with texture coordinates; vertices on seams stand in it once for each chart.

    Args:
        vertices: (N', 3) float32, in the surface's unit and frame.
        faces: (M, 3) int32 into `vertices`, in the order of the surface's faces.
        uv: (N', 2) float32 in 0..1, origin at the top left corner of the atlas.
        vertex_map: (N',) int32, the surface's vertex that each one is.
        size: (width, height) of the atlas, texels; one is about a pixel of the view.
        method: what was used: "xatlas" or "view".
        reason: why "view" was taken where charts were asked for; None if all went as asked.
    """

    vertices: Floats
    faces: Ints
    uv: Floats
    vertex_map: Ints
    size: tuple[int, int]
    method: str
    reason: str | None = None


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

    "charts" runs xatlas in a process of its own, which is stopped at the time limit. The mesh is cut into tiles of
    about 1,500 faces on the view, and every tile's charts go into one atlas. Whatever goes wrong there, the
    view's own coordinates take its place: one-to-one wherever that camera sees the surface.

    Args:
        surface: the mesh.
        view_uv: (N, 2), where the textured view sees each vertex: column and row, px.
        method: "charts" or "view".
        time_limit_s: for all of xatlas' work.
        texels_per_pixel: resolution of the atlas against the view.
        padding: texels between charts, and around the view's picture.
        max_size: largest side of the atlas, texels; a larger one is made coarser.

    Raises:
        InputError: an option is out of range, or `view_uv` does not fit the surface.
        StageError: the surface has no face.
    """
    if method not in ("charts", "view"):
        raise InputError(f"unknown unwrap method {method!r}: pass 'charts' or 'view'")
    if not (time_limit_s > 0 and texels_per_pixel > 0 and padding >= 0 and max_size >= 16):
        raise InputError(
            f"time_limit_s {time_limit_s}, texels_per_pixel {texels_per_pixel}, padding {padding}, max_size {max_size}"
            " are not all usable: pass numbers above 0, padding 0 or more, max_size 16 or more"
        )
    if view_uv.shape != (len(surface.vertices), 2) or not np.isfinite(view_uv).all():
        raise InputError(
            f"view_uv of shape {view_uv.shape} does not give {len(surface.vertices)} vertices a finite column and row"
        )
    if not len(surface.faces):
        raise StageError("cannot unwrap a mesh without faces; build the mesh again")
    seen = view_uv.astype(np.float64)
    if method == "view":
        return _view(surface, seen, texels_per_pixel, padding, max_size, None)
    try:
        return _charts(surface, seen, time_limit_s, texels_per_pixel, padding, max_size)
    except _NoChartsError as error:
        log.warning("texture coordinates are the view's own: %s", error)
        return _view(surface, seen, texels_per_pixel, padding, max_size, str(error))


class _NoChartsError(Exception):
    """xatlas gave nothing that can be used; the message says why."""


def _view(
    surface: Surface, seen: Doubles, density: float, padding: int, max_size: int, reason: str | None
) -> Unwrapped:
    low, extent = seen.min(axis=0), np.ptp(seen, axis=0)
    density = min(density, (max_size - 2 * padding - 1) / float(max(extent.max(), 1.0)))
    size = np.ceil(extent * density).astype(int) + 2 * padding + 1
    # A pixel's centre is a whole number, a texel's is a half: the 0.5 lets them meet where the density is 1.
    low = np.floor(low) if density == 1 and (np.floor(low) + size - 2 * padding > low + extent).all() else low
    uv = ((seen - low) * density + padding + 0.5) / size
    return Unwrapped(
        vertices=surface.vertices,
        faces=surface.faces,
        uv=uv.astype(np.float32),
        vertex_map=np.arange(len(seen), dtype=np.int32),
        size=(int(size[0]), int(size[1])),
        method="view",
        reason=reason,
    )


def _charts(
    surface: Surface, seen: Doubles, time_limit_s: float, density: float, padding: int, max_size: int
) -> Unwrapped:
    # xatlas hangs on coordinates that are not finite, or so large that its grids overflow.
    if not np.isfinite(surface.vertices).all():
        raise _NoChartsError("the mesh has vertices that are not finite")
    covered = float(_areas(seen, surface.faces).sum())
    density = min(density, max_size / math.sqrt(_PACKING * max(covered, 1.0)))
    tiles = _tiles(seen[surface.faces].mean(axis=1))
    maps, faces, positions = [], [], []
    for tile in tiles:
        used, local = np.unique(surface.faces[tile], return_inverse=True)
        maps.append(used)
        faces.append(local.reshape(-1, 3).astype(np.uint32))
        positions.append(_flattened(surface.vertices[used], seen[used], faces[-1]) * density)
    answer = _run_worker(
        {
            "positions": np.concatenate(positions).astype(np.float32),
            "faces": np.concatenate(faces),
            "vertex_counts": np.array([len(part) for part in maps]),
            "face_counts": np.array([len(part) for part in faces]),
            "padding": np.array(padding),
        },
        time_limit_s,
    )
    order = np.concatenate(tiles)
    vertex_map = np.concatenate(maps)[answer["vertex_map"]].astype(np.int32)
    result = np.empty_like(surface.faces)
    result[order] = answer["faces"]
    _check_answer(answer, vertex_map, result, surface, max_size)
    return Unwrapped(
        vertices=surface.vertices[vertex_map],
        faces=result,
        uv=answer["uv"].astype(np.float32),
        vertex_map=vertex_map,
        size=(int(answer["size"][0]), int(answer["size"][1])),
        method="xatlas",
    )


def _areas(corners: Doubles | Floats, faces: _Indices) -> Doubles:
    """(M,): areas of triangles in the plane or in space."""
    a, b, c = (corners[faces[:, i]].astype(np.float64) for i in range(3))
    p, q = b - a, c - a
    squared = (p * p).sum(axis=1) * (q * q).sum(axis=1) - (p * q).sum(axis=1) ** 2
    return np.asarray(0.5 * np.sqrt(np.maximum(squared, 0)))


def _tiles(centres: Doubles) -> list[_Indices]:
    """Cut faces at the median of the longer side until no part has more than _FACES_PER_TILE."""
    parts: list[_Indices] = [np.arange(len(centres))]
    tiles: list[_Indices] = []
    while parts:
        part = parts.pop()
        if len(part) <= _FACES_PER_TILE:
            tiles.append(part)
            continue
        axis = int(np.ptp(centres[part], axis=0).argmax())
        half = len(part) // 2
        part = part[np.argpartition(centres[part, axis], half)]
        parts += [part[half:], part[:half]]
    return tiles


def _flattened(vertices: Floats, seen: Doubles, faces: _Indices) -> Doubles:
    """(n, 3): a tile in pixels around its middle, with its depth pressed flat."""
    depth = vertices[:, 2].astype(np.float64)
    space = float(_areas(vertices, faces).sum())
    pixels_per_unit = math.sqrt(float(_areas(seen, faces).sum()) / space) if space > 0 else 0.0
    tile = np.column_stack([seen, depth * (_RELIEF * pixels_per_unit)])
    return np.asarray(tile - tile.mean(axis=0))


def _run_worker(tiles: dict[str, np.ndarray], time_limit_s: float) -> dict[str, np.ndarray]:
    question = io.BytesIO()
    np.savez(question, **tiles)  # type: ignore[arg-type]  # its first option is a bool, the rest are arrays
    # As a script, not with -m, which would import the whole package first; -P keeps our types.py from passing for
    # Python's. A process of its own, not multiprocessing, since that runs the caller's main module again.
    command = [sys.executable, "-P", str(_WORKER)]
    try:
        done = subprocess.run(command, input=question.getvalue(), capture_output=True, timeout=time_limit_s)
    except subprocess.TimeoutExpired:
        raise _NoChartsError(f"xatlas did not finish in {time_limit_s:g} s") from None
    except OSError as error:
        raise _NoChartsError(f"the process for xatlas cannot be started: {error.strerror or error}") from None
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip().splitlines()
        raise _NoChartsError(f"xatlas ended with status {done.returncode}: {said[-1] if said else 'it said nothing'}")
    try:
        with np.load(io.BytesIO(done.stdout)) as answer:
            return dict(answer)
    except (OSError, ValueError, EOFError) as error:
        raise _NoChartsError(f"the answer of xatlas cannot be read: {error}") from None


def _check_answer(
    answer: dict[str, np.ndarray], vertex_map: Ints, faces: Ints, surface: Surface, max_size: int
) -> None:
    uv, size = answer["uv"], answer["size"]
    if int(answer["atlases"]) != 1 or size.min() < 1:
        raise _NoChartsError(f"xatlas made {int(answer['atlases'])} atlases of {size[0]} x {size[1]} texels")
    if size.max() > max_size:
        raise _NoChartsError(f"the atlas of {size[0]} x {size[1]} texels is larger than {max_size}")
    if not (np.isfinite(uv).all() and uv.min() >= 0 and uv.max() <= 1):
        raise _NoChartsError("xatlas gave coordinates outside its atlas")
    if not np.array_equal(vertex_map[faces], surface.faces):
        raise _NoChartsError("xatlas changed the mesh")
    log.debug("%d charts in %d x %d texels", int(answer["charts"]), size[0], size[1])
