"""Write a textured mesh as GLB: glTF 2.0 in one binary file."""

from __future__ import annotations

import json
import math
import os
import struct
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from stereo_gpu.files import write_whole
from stereo_gpu.model_files.frame import METRES_SHOWN, check_mesh, to_viewer
from stereo_gpu.model_files.texture_file import check_texture_format, pack_texture
from stereo_gpu.types import UNSCALED, Floats, Mesh, RectifiedPair, View

_ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 34962, 34963
_FLOAT, _UNSIGNED_SHORT, _UNSIGNED_INT = 5126, 5123, 5125
_MOST_SHORT = 65_535  # vertices that 16 bits can tell apart; the last number is kept for other uses
_LINEAR, _LINEAR_MIPMAP_LINEAR, _CLAMP_TO_EDGE = 9729, 9987, 33071


@dataclass(frozen=True, kw_only=True)
class Standpoint:
    """Where a rectified camera stood and how much it saw.

    Args:
        name: what the camera is called in the file.
        right: how far it stands to the right of the left camera, in the mesh's unit.
        half_width, half_height: tangents of the angles from its axis to the farther borders of its picture.
    """

    name: str
    right: float
    half_width: float
    half_height: float


def standpoint(pair: RectifiedPair, view: View) -> Standpoint:
    """That of the camera of `view`."""
    height, width = pair.left.shape[:2]
    cx = pair.cx_right if view is View.RIGHT else pair.cx_left
    # glTF's cameras look through the middle of their pictures: the farther border on either side must be seen.
    return Standpoint(
        name=f"{view} camera",
        right=pair.baseline if view is View.RIGHT else 0.0,
        half_width=max(cx + 0.5, width - 0.5 - cx) / pair.focal_px,
        half_height=max(pair.cy + 0.5, height - 0.5 - pair.cy) / pair.focal_px,
    )


def write_glb(
    path: str | os.PathLike[str],
    mesh: Mesh,
    *,
    texture_format: str = "png",
    quality: int | None = None,
    camera: Standpoint | None = None,
) -> Path:
    """Write metres, y up, z towards the viewer, the left camera at the origin.

    The material is unlit (KHR_materials_unlit), since the photo already holds the light it was taken in; a
    viewer without that extension shows a rough, non-metallic surface, with normals that it makes itself. Both sides
    are drawn: a surface seen from one side has no back of its own.

    Args:
        path: the file.
        mesh: what to write.
        texture_format: png, jpeg or webp. WebP needs viewers that know EXT_texture_webp: there is no second picture
            for others, which would take more room than WebP saves.
        quality: of the texture; see `pack_texture`.
        camera: from where programs that open a file at its own camera show it first; None for none.

    Source: Khronos, glTF 2.0 specification, sections 3 (JSON) and 4 (GLB).

    Raises:
        InputError: the mesh's unit is unknown or its arrays do not fit, the texture is too large for its format or
            this is unknown, or the file cannot be written.
    """
    return write_whole(path, pack_glb(mesh, texture_format=texture_format, quality=quality, camera=camera))


def pack_glb(
    mesh: Mesh, *, texture_format: str = "png", quality: int | None = None, camera: Standpoint | None = None
) -> bytes:
    """The bytes of the file that `write_glb` writes."""
    check_mesh(mesh)
    check_texture_format(texture_format, quality)
    positions = (to_viewer(mesh.vertices) * METRES_SHOWN[mesh.unit]).astype("<f4")
    corners, count = mesh.faces.size, len(positions)
    short = count <= _MOST_SHORT
    parts = [
        (mesh.faces.astype("<u2" if short else "<u4").tobytes(), _ELEMENT_ARRAY_BUFFER),
        (positions.tobytes(), _ARRAY_BUFFER),
        (mesh.uv.astype("<f4").tobytes(), _ARRAY_BUFFER),
        (pack_texture(mesh.texture, texture_format, quality), None),
    ]
    views: list[dict[str, Any]] = []
    pieces: list[bytes] = []
    at = 0
    for part, target in parts:
        view = {"buffer": 0, "byteOffset": at, "byteLength": len(part)}
        views.append(view if target is None else view | {"target": target})
        pieces += [part, bytes(-len(part) % 4)]
        at += len(part) + len(pieces[-1])
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": _generator()},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"name": "reconstruction", "nodes": [0]}],
        "nodes": [{"name": "surface", "mesh": 0}],
        "meshes": [
            {
                "name": "surface",
                "primitives": [{"attributes": {"POSITION": 1, "TEXCOORD_0": 2}, "indices": 0, "material": 0}],
            }
        ],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": _UNSIGNED_SHORT if short else _UNSIGNED_INT,
                "count": corners,
                "type": "SCALAR",
            },
            {
                "bufferView": 1,
                "componentType": _FLOAT,
                "count": count,
                "type": "VEC3",
                "min": positions.min(axis=0).tolist(),
                "max": positions.max(axis=0).tolist(),
            },
            {"bufferView": 2, "componentType": _FLOAT, "count": count, "type": "VEC2"},
        ],
        "materials": [
            {
                "name": "photo",
                "doubleSided": True,
                "pbrMetallicRoughness": {
                    "baseColorTexture": {"index": 0},
                    "metallicFactor": 0.0,
                    "roughnessFactor": 1.0,
                },
                "extensions": {"KHR_materials_unlit": {}},
            }
        ],
        "textures": [{"sampler": 0, "source": 0}],
        "samplers": [
            {
                "magFilter": _LINEAR,
                "minFilter": _LINEAR_MIPMAP_LINEAR,
                "wrapS": _CLAMP_TO_EDGE,
                "wrapT": _CLAMP_TO_EDGE,
            }
        ],
        "images": [{"name": "texture", "bufferView": 3, "mimeType": f"image/{texture_format}"}],
        "bufferViews": views,
        "buffers": [{"byteLength": at}],
    }
    if texture_format == "webp":
        document["extensionsUsed"] = ["EXT_texture_webp", "KHR_materials_unlit"]
        document["extensionsRequired"] = ["EXT_texture_webp"]
        document["textures"] = [{"sampler": 0, "extensions": {"EXT_texture_webp": {"source": 0}}}]
    if mesh.unit == UNSCALED:
        document["asset"] |= {"extras": {"scale": "unknown: 1 m is the distance between the cameras"}}
    if camera is not None:
        document |= _camera(camera, METRES_SHOWN[mesh.unit], positions, document["nodes"])
    described = json.dumps(document, separators=(",", ":")).encode()
    described += b" " * (-len(described) % 4)
    header = struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(described) + 8 + at)
    chunks = [struct.pack("<I4s", len(described), b"JSON"), described, struct.pack("<I4s", at, b"BIN\0")]
    return b"".join([header, *chunks, *pieces])


def _camera(camera: Standpoint, metres: float, positions: Floats, nodes: Any) -> dict[str, Any]:
    """The entries of a document that put a camera into it; none where nothing lies before it."""
    depths = -positions[:, 2]
    if depths.max() <= 0:
        return {}
    lens = {
        "yfov": 2 * math.atan(camera.half_height),
        "aspectRatio": camera.half_width / camera.half_height,
        # Room on both sides of the model to walk about in, but not so much that a viewer's depth gets coarse.
        "znear": float(depths[depths > 0].min()) / 10,
        "zfar": float(depths.max()) * 10,
    }
    return {
        "cameras": [{"name": camera.name, "type": "perspective", "perspective": lens}],
        "nodes": [*nodes, {"name": camera.name, "camera": 0, "translation": [camera.right * metres, 0.0, 0.0]}],
        "scenes": [{"name": "reconstruction", "nodes": [0, 1]}],
    }


@cache  # looked up in files, which takes 3 ms
def _generator() -> str:
    try:
        return f"stereo-gpu {version('stereo-gpu')}"
    except PackageNotFoundError:  # run from a checkout that is not installed
        return "stereo-gpu"
