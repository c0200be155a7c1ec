"""Write a file, or all files of a folder, whole or not at all."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from stereo_gpu.errors import InputError


def write_whole(path: str | os.PathLike[str], content: bytes | str) -> Path:
    """Write `content` to `path` so that nobody ever sees half of it; text is written as UTF-8.

    The bytes go to a temporary file in the same folder, reach the disk and then take the name in one step.
    A file that stood there before stays as it was if anything fails; a link is followed.

    Raises:
        InputError: the folder is missing or cannot be written, the disk is full, or `path` is a folder or device.
    """
    path = Path(path)
    target = _target(path)
    # A file's name may hold bytes that are no UTF-8; what tells of it shows them as \udcff rather than failing.
    data = content.encode(errors="backslashreplace") if isinstance(content, str) else content
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


@contextmanager
def whole_folder(folder: str | os.PathLike[str]) -> Iterator[Path]:
    """Fill a folder so that it gets all of its new files or none.

    Yields a folder within `folder`, which is made if missing. What is written there moves up when the block ends
    well, over files of the same names; otherwise it vanishes, and so does every folder that was made for it.

    Raises:
        InputError: the folder cannot be made or written, or holds a folder of the name of a file.
    """
    folder = Path(folder)
    check_writable(folder)
    missing = [part for part in (folder, *folder.parents) if not part.exists()]
    staging = folder / f".{secrets.token_hex(6)}.part"
    done = False
    try:
        try:
            staging.mkdir(parents=True)
        except OSError as error:
            raise _cannot_write(folder, error) from error
        yield staging
        written = sorted(staging.iterdir())
        for file in written:
            if (folder / file.name).is_dir():
                raise InputError(
                    f"cannot write {folder / file.name}: it is a folder; name another folder than {folder}"
                )
        for file in written:
            file.replace(folder / file.name)
        done = True
    finally:
        shutil.rmtree(staging, ignore_errors=True)
        for part in [] if done else missing:
            # It may hold something else by now, or not have been made.
            with suppress(OSError):
                part.rmdir()


def check_writable(folder: str | os.PathLike[str]) -> None:
    """Refuse a folder in which nothing could be written, before any work is done; it need not exist yet.

    Raises:
        InputError: it is a file, or neither it nor the nearest folder above it can be written.
    """
    nearest = Path(folder).absolute()
    try:
        while not nearest.exists() and nearest != nearest.parent:
            nearest = nearest.parent
    except OSError as error:  # a name that is too long, a link to itself
        raise _cannot_write(Path(folder), error) from error
    if not nearest.is_dir():
        raise InputError(f"cannot write to {folder}: {nearest} is a file; name another folder")
    # Permissions do not bind root, and some file systems take nothing whatever they say: only a trial tells.
    trial = nearest / f".{secrets.token_hex(6)}.part"
    try:
        trial.mkdir()
        trial.rmdir()
    except OSError as error:
        raise _cannot_write(Path(folder), error) from error


def check_writable_file(path: str | os.PathLike[str]) -> None:
    """Refuse a file that could not be written, before any work is done.

    Raises:
        InputError: it is a folder or device, or its own folder is missing or cannot be written.
    """
    path = Path(path)
    _target(path)
    check_writable(path.parent)


def _target(path: Path) -> Path:
    """The file that is meant, links followed; it need not exist yet."""
    try:
        target = path.resolve()
        if target.is_dir():
            raise InputError(f"{path} is a folder: name a file in it")
        if target.exists() and not target.is_file():
            # A new file of its name would take the place of /dev/null.
            raise InputError(f"{path} is a device or pipe: name a file")
        if not target.parent.is_dir():
            raise InputError(f"cannot write {path}: there is no folder {path.parent}; make it first")
    except (OSError, ValueError) as error:  # a name that is too long, a zero byte in it
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"cannot write {str(path)!r:.200}: {reason}; name another file") from error
    return target


def _cannot_write(folder: Path, error: OSError) -> InputError:
    return InputError(f"cannot write to {folder}: {error.strerror or error}; name another folder")
