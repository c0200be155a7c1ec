"""Read a model back from a GLB file, ours or another program's."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.model_files.glb_file import DAMAGE, GlbFile, as_object, open_glb
from stereo_gpu.model_files.glb_textures import SIDE_LIMIT, Paint, lay_out, read_paint
from stereo_gpu.types import Doubles, Floats, Ints, Mesh

FACE_LIMIT = 20_000_000
TEXEL_LIMIT = SIDE_LIMIT**2
_TRIANGLES, _STRIP, _FAN = 4, 5, 6


@dataclass(frozen=True, kw_only=True)
class _Part:
    """One primitive where it stands in the scene."""

    vertices: Floats
    faces: Ints
    uv: Floats
    paint: Paint


def read_glb(path: str | os.PathLike[str]) -> Mesh:
    """The triangles of a GLB's scene as one mesh with one texture, in metres.

    What `write_glb` wrote comes back as it is: vertices to the bit but in metres, faces, uv and texture. Of other
    programs' files the base colour is read, as picture, as plain colour or both; several are put on one sheet. A
    surface without a material is clay. Lights, bones, cameras, colours of vertices and see-through parts are passed
    over. Axes are turned back to those of `Mesh` (y down, z forward), and the origin stays: only our own models are
    sure to lie in front of it.

    Source: Khronos, glTF 2.0 specification.

    Raises:
        InputError: it is no GLB, broken, has no triangles, too many, or needs an extension that is not understood.
        PictureError: a picture in it cannot be decoded.
    """
    file = open_glb(path)
    try:
        with np.errstate(all="ignore"):  # damaged numbers: what is not finite is refused where it matters
            parts = list(_parts(file))
            if not parts:
                raise InputError(f"{path} has no triangles to show: export the surface of the model, too")
            texture, uv = lay_out([(part.paint, part.uv) for part in parts], file)
    except DAMAGE as error:
        raise file.damaged(f"{type(error).__name__}: {error!s:.80}") from error
    first = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    return Mesh(
        vertices=np.concatenate([part.vertices for part in parts]),
        faces=np.concatenate([part.faces + np.int32(start) for part, start in zip(parts, first, strict=True)]),
        uv=uv,
        texture=texture,
        unit="m",
    )


def _parts(file: GlbFile) -> Iterator[_Part]:
    faces = vertices = 0
    paints: dict[Any, Paint] = {}
    for node, place in _placed(file):
        if "mesh" not in node:
            continue
        for primitive in file.entry("meshes", node["mesh"])["primitives"]:
            if primitive.get("mode", _TRIANGLES) not in (_TRIANGLES, _STRIP, _FAN):
                continue
            part = _part(file, primitive, place, paints)
            faces += len(part.faces)
            vertices += len(part.vertices)
            if max(faces, vertices) > FACE_LIMIT:  # a small file can show one part a million times
                raise InputError(f"{file.name} has more than {FACE_LIMIT} triangles or vertices: decimate the model")
            if len(part.faces):
                yield part


def _part(file: GlbFile, primitive: dict[str, Any], place: Doubles, paints: dict[Any, Paint]) -> _Part:
    attributes = as_object(primitive["attributes"])
    positions = file.array(attributes["POSITION"], 3)
    if not np.isfinite(positions).all():
        raise file.damaged("a vertex is not finite")
    named = file.array(primitive["indices"], 1)[:, 0] if "indices" in primitive else np.arange(len(positions))
    if named.dtype.kind not in "iu" or (len(named) and named.max() >= len(positions)):
        raise file.damaged(f"faces name vertices beyond {len(positions)}")
    faces = _triangles(named.astype(np.int32), primitive.get("mode", _TRIANGLES))
    if (place != np.eye(4)).any():
        positions = positions.astype(np.float64) @ place[:3, :3].T + place[:3, 3]
        if np.linalg.det(place[:3, :3]) < 0:  # a mirrored copy: what was the front is the back
            faces = faces[:, ::-1]
    material = primitive.get("material")
    if material not in paints:
        paints[material] = read_paint(file, material)
        if sum(paint.picture.size for paint in paints.values() if paint.picture is not None) > 3 * TEXEL_LIMIT:
            raise InputError(f"{file.name} has over {TEXEL_LIMIT} px of textures: scale them down")
    paint = paints[material]
    which = f"TEXCOORD_{paint.uv_set}"
    uv = np.full((len(positions), 2), 0.5, np.float32)
    if paint.picture is not None and which in attributes:
        uv = file.array(attributes[which], 2).astype(np.float32)
        if uv.shape[0] != len(positions):
            raise file.damaged("texture coordinates do not fit the vertices")
    # Exact: a change of sign only, where the scene does not move the part.
    turned = positions.astype(np.float32) * np.array([1, -1, -1], np.float32)
    if not np.isfinite(turned).all():
        raise file.damaged("a vertex is moved out of all bounds")
    return _Part(vertices=turned, faces=np.ascontiguousarray(faces), uv=uv, paint=paint)


def _triangles(named: Ints, mode: int) -> Ints:
    """(M, 3) of a list, strip or fan of vertices."""
    if mode == _TRIANGLES:
        return named[: len(named) // 3 * 3].reshape(-1, 3)
    count = max(0, len(named) - 2)
    if mode == _FAN:
        return np.stack([named[1 : count + 1], named[2 : count + 2], np.broadcast_to(named[:1], count)], axis=1)
    odd = np.arange(count) % 2
    order = np.arange(count)[:, None] + np.stack([np.zeros(count, int), 1 + odd, 2 - odd], axis=1)
    return np.asarray(named[order], np.int32).reshape(-1, 3)


def _placed(file: GlbFile) -> Iterator[tuple[dict[str, Any], Doubles]]:
    """Every node of the scene with its transform to the scene, (4, 4)."""
    nodes = file.document.get("nodes", [])
    if file.document.get("scenes"):
        roots = file.entry("scenes", file.document.get("scene", 0)).get("nodes", [])
    else:
        below = {child for node in nodes for child in node.get("children", [])}
        roots = [index for index in range(len(nodes)) if index not in below]
    waiting = deque((index, np.eye(4)) for index in roots)
    seen = set()
    while waiting:
        index, parent = waiting.popleft()
        node = file.entry("nodes", index)
        if index in seen:
            raise file.damaged(f"node {index} stands in the scene twice")
        seen.add(index)
        place = parent @ _transform(node)
        yield node, place
        waiting += [(child, place) for child in node.get("children", [])]


def _transform(node: dict[str, Any]) -> Doubles:
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    x, y, z, w = (float(part) for part in node.get("rotation", (0, 0, 0, 1)))
    place = np.eye(4)
    place[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    place[:3, :3] *= np.array(node.get("scale", (1, 1, 1)), np.float64)
    place[:3, 3] = node.get("translation", (0, 0, 0))
    return place
