"""Write a textured mesh as GLB: glTF 2.0 in one binary file."""

from __future__ import annotations

import json
import os
import struct
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from stereo_gpu.export_frame import METRES_SHOWN, check_mesh, encode_png, to_viewer
from stereo_gpu.files import write_whole
from stereo_gpu.types import Mesh

_ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 34962, 34963
_FLOAT, _UNSIGNED_INT = 5126, 5125
_LINEAR, _LINEAR_MIPMAP_LINEAR, _CLAMP_TO_EDGE = 9729, 9987, 33071


def write_glb(path: str | os.PathLike[str], mesh: Mesh) -> Path:
    """Write metres, y up, z towards the viewer, with the texture as PNG inside.

    The material is unlit (KHR_materials_unlit), since the photo already holds the light it was taken in; a
    viewer without that extension shows a rough, non-metallic surface. Both sides are drawn: a surface seen from one
    side has no back of its own. The origin is the left camera.

    Source: Khronos, glTF 2.0 specification, sections 3 (JSON) and 4 (GLB).

    Raises:
        InputError: the mesh's unit is unknown or its arrays do not fit, or the file cannot be written.
    """
    check_mesh(mesh)
    positions = (to_viewer(mesh.vertices) * METRES_SHOWN[mesh.unit]).astype(np.float32)
    parts = [
        np.ascontiguousarray(mesh.faces, "<u4").tobytes(),
        positions.astype("<f4").tobytes(),
        np.ascontiguousarray(mesh.uv, "<f4").tobytes(),
        encode_png(mesh.texture),
    ]
    views: list[dict[str, Any]] = []
    binary = b""
    for part, target in zip(parts, (_ELEMENT_ARRAY_BUFFER, _ARRAY_BUFFER, _ARRAY_BUFFER, None), strict=True):
        view = {"buffer": 0, "byteOffset": len(binary), "byteLength": len(part)}
        views.append(view if target is None else view | {"target": target})
        binary += part + bytes(-len(part) % 4)
    corners, count = mesh.faces.size, len(positions)
    document = {
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
            {"bufferView": 0, "componentType": _UNSIGNED_INT, "count": corners, "type": "SCALAR"},
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
        "images": [{"name": "texture", "bufferView": 3, "mimeType": "image/png"}],
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
    }
    described = json.dumps(document, separators=(",", ":")).encode()
    described += b" " * (-len(described) % 4)
    chunks = struct.pack("<I4s", len(described), b"JSON") + described
    chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return write_whole(path, struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)


def _generator() -> str:
    try:
        return f"stereo-gpu {version('stereo-gpu')}"
    except PackageNotFoundError:  # run from a checkout that is not installed
        return "stereo-gpu"
