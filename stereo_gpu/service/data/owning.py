"""One service a data folder: whoever has locked it, even where an earlier one was killed."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from stereo_gpu.errors import InputError
from stereo_gpu.service.data.paths import UPLOAD, Paths


@contextmanager
def own(paths: Paths) -> Iterator[None]:
    """Make the folder if it is missing, and keep every other service out of it until the block ends.

    What an earlier one that was killed was being sent goes: nobody sends it any more.

    Raises:
        InputError: another service has it, it holds files that are none of ours, or it cannot be written.
    """
    _make(paths)
    held = os.open(paths.lock, os.O_RDWR | os.O_CREAT, 0o600)
    try:
        if _lock(paths.root, held):
            for part in paths.uploads.iterdir():
                if UPLOAD.fullmatch(part.name):
                    shutil.rmtree(part, ignore_errors=True)
        with suppress(OSError):  # on a full disk: it is for people alone, and who looks after it may free some room
            os.ftruncate(held, 0)
            os.write(held, f"{os.getpid()}\n".encode())
        yield
    finally:
        os.close(held)


def _make(paths: Paths) -> None:
    root = paths.root
    try:
        root.mkdir(mode=0o700, parents=True, exist_ok=True)
        held = {part.name for part in root.iterdir() if not part.name.startswith(".")} - {"lost+found"}
        if held and not held & {paths.lock.name, paths.database.name}:
            raise InputError(f"{root} holds other files, such as {min(held)}: name a new or an empty folder")
        paths.lock.touch(mode=0o600)  # first: it tells that the folder is ours
        for folder in (paths.jobs, paths.rigs, paths.outlines, paths.uploads):
            folder.mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot write to {root}: {error.strerror or error}; name another folder") from error


def _lock(root: Path, held: int) -> bool:
    """Whether it is locked, which some systems cannot."""
    if os.name != "posix":
        return False
    import fcntl

    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        process = os.pread(held, 20, 0).decode(errors="replace").strip() or "unknown"
        raise InputError(f"process {process} serves {root} already: end it, or name another folder") from error
    except OSError as error:
        raise InputError(
            f"{root} cannot be locked ({error.strerror or error}): name a folder on a file system that knows locks"
        ) from error
    return True
