"""What lies in a folder of results: each file's name, size, hash and type, written when all of them are on the disk."""

from __future__ import annotations

import hashlib
import json
import os
import re
from dataclasses import asdict, dataclass
from pathlib import Path

from stereo_gpu.files import write_whole
from stereo_gpu.service.refusals import NotFound, StoreError

MANIFEST_NAME = "manifest.json"
_VERSION = 1
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,99}")
_BLOCK = 1 << 20
# Python's own table depends on the machine, and knows few of these.
_TYPES = {
    ".csv": "text/csv; charset=utf-8",
    ".glb": "model/gltf-binary",
    ".html": "text/html; charset=utf-8",
    ".jpg": "image/jpeg",
    ".json": "application/json",
    ".mtl": "model/mtl",
    ".obj": "model/obj",
    ".pfm": "image/x-portable-floatmap",
    ".png": "image/png",
    ".svg": "image/svg+xml",
    ".txt": "text/plain; charset=utf-8",
    ".vtp": "application/xml",
    ".webp": "image/webp",
}


@dataclass(frozen=True, kw_only=True)
class ManifestFile:
    """A file of a result.

    Args:
        name: in its folder.
        bytes: its size.
        sha256: of its bytes, hexadecimal.
        type: as a Content-Type.
    """

    name: str
    bytes: int
    sha256: str
    type: str


@dataclass(frozen=True, kw_only=True)
class Manifest:
    """The files of a result, by name in order; its own file is not among them."""

    files: tuple[ManifestFile, ...]

    @property
    def bytes(self) -> int:
        """What all of them take."""
        return sum(file.bytes for file in self.files)

    def file(self, name: str) -> ManifestFile:
        """The file of this name.

        Raises:
            NotFound: there is none: only what the manifest names is ever read from the folder.
        """
        for file in self.files:
            if file.name == name:
                return file
        raise NotFound(f"there is no file {name[:60]!r}: ask for the list of files")


def seal(folder: Path) -> Manifest:
    """See that all files of a folder are on the disk, and write its manifest last: a folder with one is whole.

    Raises:
        StoreError: it holds a folder, a link or an odd name, or cannot be read or written.
    """
    try:
        parts = sorted(part for part in folder.iterdir() if part.name != MANIFEST_NAME)
        for part in parts:
            if not (_NAME.fullmatch(part.name) and part.is_file() and not part.is_symlink()):
                raise StoreError(f"{part} cannot be part of a result: only plain files of plain names can")
        manifest = Manifest(files=tuple(_describe(part) for part in parts))
        content = {"version": _VERSION, "files": [asdict(file) for file in manifest.files]}
        write_whole(folder / MANIFEST_NAME, json.dumps(content, indent=1) + "\n")
        flush_folder(folder)
    except OSError as error:
        raise StoreError(f"cannot seal {folder}: {error.strerror or error}; see that it can be written") from error
    return manifest


def read_manifest(folder: Path) -> Manifest | None:
    """The manifest of a whole folder; None where there is none, or a file is missing or of another size."""
    try:
        content = json.loads((folder / MANIFEST_NAME).read_bytes())
        files = tuple(ManifestFile(**file) for file in content["files"])
        whole = content["version"] == _VERSION and all(
            _NAME.fullmatch(file.name) and (folder / file.name).stat().st_size == file.bytes for file in files
        )
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return Manifest(files=files) if whole else None


def flush_folder(folder: Path) -> None:
    """See that the names in a folder are on the disk; systems without such a thing do it by themselves.

    Raises:
        OSError: it cannot be read.
    """
    if os.name == "posix":
        held = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(held)
        finally:
            os.close(held)


def flush_file(path: Path) -> None:
    """See that the bytes of a file are on the disk.

    Raises:
        OSError: it cannot be read.
    """
    with path.open("rb+") as stream:
        os.fsync(stream.fileno())


def _describe(path: Path) -> ManifestFile:
    digest, size = hashlib.sha256(), 0
    with path.open("rb+") as stream:
        while block := stream.read(_BLOCK):
            digest.update(block)
            size += len(block)
        os.fsync(stream.fileno())
    kind = _TYPES.get(path.suffix.lower(), "application/octet-stream")
    return ManifestFile(name=path.name, bytes=size, sha256=digest.hexdigest(), type=kind)
