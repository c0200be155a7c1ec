"""Write a file whole or not at all."""

from __future__ import annotations

import os
import secrets
from pathlib import Path

from stereo_gpu.errors import InputError


def write_whole(path: str | os.PathLike[str], content: bytes | str) -> Path:
    """Write `content` to `path` so that nobody ever sees half of it; text is written as UTF-8.

    The bytes go to a temporary file in the same folder, reach the disk and then take the name in one step.
    A file that stood there before stays as it was if anything fails; a link is followed.

    Raises:
        InputError: the folder is missing or cannot be written, the disk is full, or `path` is a folder.
    """
    path = Path(path)
    target = path.resolve()
    if target.is_dir():
        raise InputError(f"{path} is a folder: name a file in it")
    if not target.parent.is_dir():
        raise InputError(f"cannot write {path}: there is no folder {path.parent}; make it first")
    data = content.encode() if isinstance(content, str) else content
    # Not tempfile: it would leave the file readable by its owner alone, whatever the umask says.
    temporary = target.parent / f".{target.name[:100]}.{secrets.token_hex(6)}.part"
    try:
        with temporary.open("xb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(target)
    except OSError as error:
        raise InputError(
            f"cannot write {path} ({len(data)} bytes): {error.strerror or error}; choose a folder that can be"
            " written and has room"
        ) from error
    finally:
        temporary.unlink(missing_ok=True)
    return path


def check_writable(folder: str | os.PathLike[str]) -> None:
    """Refuse a folder in which nothing could be written, before any work is done; it need not exist yet.

    Raises:
        InputError: it is a file, or neither it nor the nearest folder above it can be written.
    """
    nearest = Path(folder).absolute()
    while not nearest.exists() and nearest != nearest.parent:
        nearest = nearest.parent
    if not nearest.is_dir():
        raise InputError(f"cannot write to {folder}: {nearest} is a file; name another folder")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise InputError(f"cannot write to {folder}: no permission to write in {nearest}; name another folder")
