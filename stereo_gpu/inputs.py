"""What a pair comes as, arrays or files, and the hashes by which a result tells what it was made from."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import numpy as np

from stereo_gpu.images import read_image
from stereo_gpu.types import Picture

Source = Picture | str | os.PathLike[str]


def read_source(given: Source) -> Picture:
    """The picture itself."""
    return given if isinstance(given, np.ndarray) else read_image(given)


def describe(given: Source) -> dict[str, str]:
    """Name and sha256 of a picture, of the file's bytes or of the array's."""
    if isinstance(given, np.ndarray):
        return {"name": "array", "sha256": hash_array(given)}
    path = Path(given)
    # A name of bytes that are no text could not be written into the result's files.
    name = os.fsencode(path.name).decode("utf-8", "replace")
    return {"name": name, "sha256": hash_file(path)}


def hash_array(array: Picture) -> str:
    """The sha256 of an array's bytes."""
    return hashlib.sha256(array.tobytes()).hexdigest()


def hash_file(path: Path) -> str:
    """The sha256 of a file.

    Raises:
        OSError: it cannot be read.
    """
    return hashlib.sha256(path.read_bytes()).hexdigest()
