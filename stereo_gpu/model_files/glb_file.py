"""Open a GLB file: its JSON, its arrays and its pictures, checked before any of it is believed."""

from __future__ import annotations

import base64
import binascii
import json
import os
import stat
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.errors import InputError

BYTE_LIMIT = 1 << 30
_NUMBERS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
# What may be required of a reader and makes no difference here, or is understood.
_KNOWN = ("KHR_materials_", "KHR_lights_", "KHR_mesh_quantization", "KHR_texture_transform", "EXT_texture_webp")


@dataclass(frozen=True, kw_only=True)
class GlbFile:
    """A GLB file in memory.

    Args:
        name: to call it by in messages.
        document: its JSON.
        binary: the bytes beside it.
    """

    name: str
    document: dict[str, Any]
    binary: bytes

    def entry(self, kind: str, index: Any) -> dict[str, Any]:
        """One of the document's meshes, nodes, accessors and so on.

        Raises:
            InputError: there is no such entry.
        """
        entries = self.document.get(kind, [])
        if isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < len(entries):
            raise self.damaged(f"it names {kind} {index!r:.20} of {len(entries)}")
        return as_object(entries[index])

    def array(self, index: Any, columns: int) -> NDArray[Any]:
        """An accessor's numbers, (N, columns) in their own type; normalised ones as float32.

        Source: Khronos, glTF 2.0 specification, section 3.6.2.

        Raises:
            InputError: it lies outside the file, is of another shape, or sparse.
        """
        accessor = self.entry("accessors", index)
        if "sparse" in accessor or "bufferView" not in accessor:
            raise InputError(f"{self.name} holds sparse arrays: export it again without morph targets or compression")
        kind = np.dtype(_NUMBERS[accessor["componentType"]])
        count = size(accessor["count"])
        if _COLUMNS.get(accessor["type"]) != columns:
            raise self.damaged(f"an array of {count} {accessor['type']!r:.20} stands where {columns} columns belong")
        view = self.entry("bufferViews", accessor["bufferView"])
        data = self.view(accessor["bufferView"])
        stride = size(view.get("byteStride", 0)) or kind.itemsize * columns
        values: NDArray[Any] = np.array(
            np.ndarray(
                (count, columns), kind, data, size(accessor.get("byteOffset", 0)), strides=(stride, kind.itemsize)
            )
        )
        if accessor.get("normalized") and kind.kind in "iu":
            values = np.maximum(values.astype(np.float32) / np.float32(np.iinfo(kind).max), np.float32(-1))
        return values

    def view(self, index: Any) -> bytes:
        """The bytes of a buffer view.

        Raises:
            InputError: they lie outside the file.
        """
        view = self.entry("bufferViews", index)
        buffer = self.entry("buffers", view["buffer"])
        data = self.binary if "uri" not in buffer else self.embedded(buffer["uri"])
        begin, length = size(view.get("byteOffset", 0)), size(view["byteLength"])
        if begin + length > len(data):
            raise self.damaged(f"bytes {begin} to {begin + length} are named, it has {len(data)}")
        return data[begin : begin + length]

    def embedded(self, uri: Any) -> bytes:
        """The bytes of a data: URI.

        Raises:
            InputError: it names another file.
        """
        head, comma, body = str(uri).partition(";base64,")
        if not head.startswith("data:") or not comma:
            raise InputError(
                f"{self.name} needs the file {str(uri)[:60]!r} beside it: save it as one GLB with all in it"
            )
        return base64.b64decode(body, validate=True)

    def damaged(self, what: str) -> InputError:
        """The error of a file that contradicts itself."""
        return InputError(f"{self.name} is damaged ({what}): copy or export it again")


def open_glb(path: str | os.PathLike[str]) -> GlbFile:
    """Read a GLB file of glTF 2.0 and check its frame.

    Source: Khronos, glTF 2.0 specification, section 4.

    Raises:
        InputError: it is missing, no GLB, cut off, too large, or needs an extension that is not understood.
    """
    path = Path(path)
    data = _read(path)
    if data[:4] != b"glTF":
        hint = "save it as GLB, one binary file" if path.suffix.lower() == ".gltf" else "give a .glb file"
        raise InputError(f"{path} is no GLB: {hint}")
    if len(data) < 20:
        raise InputError(f"{path} is cut off: it has {len(data)} bytes; copy it again")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise InputError(f"{path} is GLB version {version}: save it as glTF 2.0")
    if length > len(data):
        raise InputError(f"{path} is cut off: it has {len(data)} of {length} bytes; copy it again")
    chunks: dict[bytes, bytes] = {}
    at = 12
    while at + 8 <= length:
        size_here, kind = struct.unpack_from("<I4s", data, at)
        if at + 8 + size_here > length:
            raise InputError(f"{path} is damaged (a part is longer than the file): copy or export it again")
        chunks.setdefault(kind, data[at + 8 : at + 8 + size_here])
        at += 8 + size_here
    try:
        document = as_object(json.loads(chunks.get(b"JSON", b"")))
    except (ValueError, TypeError, RecursionError) as error:
        raise InputError(f"{path} is damaged (its JSON cannot be read): copy or export it again") from error
    required = document.get("extensionsRequired", [])
    unknown = [name for name in required if not str(name).startswith(_KNOWN)] if isinstance(required, list) else []
    if unknown:
        raise InputError(f"{path} needs {str(unknown[0])[:60]}, which is not understood here: export it without")
    return GlbFile(name=str(path), document=document, binary=chunks.get(b"BIN\0", b""))


def as_object(value: Any) -> dict[str, Any]:
    """`value`, which must be a JSON object.

    Raises:
        TypeError: it is none.
    """
    if not isinstance(value, dict):
        raise TypeError(f"{type(value).__name__} where an object belongs")
    return value


def size(value: Any) -> int:
    """`value`, which must be a whole number, 0 or more.

    Raises:
        TypeError: it is none.
    """
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise TypeError(f"{value!r:.20} where a size belongs")
    return value


# What reading damaged JSON and arrays can raise, besides what is said above.
DAMAGE = (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError, binascii.Error)


def _read(path: Path) -> bytes:
    try:
        mode = path.stat()
        if not stat.S_ISREG(mode.st_mode):
            raise InputError(f"{path} is no file: give a .glb file")
        if mode.st_size > BYTE_LIMIT:
            raise InputError(f"{path} has {mode.st_size} bytes, the limit is {BYTE_LIMIT}: decimate the model")
        return path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path} cannot be read: {reason}; check the path and its permissions") from error
