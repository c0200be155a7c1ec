"""Bytes of a calibration file, read with suspicion."""

from __future__ import annotations

import os
import stat
from dataclasses import dataclass
from pathlib import Path

from stereo_gpu.errors import InputError
from stereo_gpu.rig import LARGEST_FILE as LARGEST_OWN

LARGEST_FILE = 4 * 2**20  # bytes, of other programs; the toolbox's file of a hundred views takes about 1 MB


@dataclass(frozen=True)
class Source:
    """A file's name, for messages, and its bytes."""

    name: str
    data: bytes


def read_source(path: str | os.PathLike[str]) -> Source:
    """Read a whole file that is no larger than our own rigs can be.

    Raises:
        InputError: it is missing, a folder, a device, empty, too large or cannot be read.
    """
    path = Path(path)
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise InputError(f"{path} is a device or pipe: give a calibration file")
        with path.open("rb") as stream:
            data = stream.read(LARGEST_OWN + 1)
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file; check the path") from None
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path} cannot be read: {reason}; check the path and its permissions") from error
    if not data.strip():
        raise InputError(f"{path} is empty: copy it again")
    if len(data) > LARGEST_OWN:
        raise InputError(f"{path} is larger than {LARGEST_OWN >> 20} MiB: is this a calibration file?")
    return Source(str(path), data)
