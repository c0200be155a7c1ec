"""A folder of pairs: left0001.png, right0001.png and so on, and pairs.jsonl, which lists them, a JSON line each.

Whatever ends the program, every picture is whole, every line is whole, and a line stands only for two pictures that
are there: both are written under hidden names first, then take their own names, then the line is added. A later run
goes on with the next number and writes over nothing.
"""

from __future__ import annotations

import json
import logging
import os
import re
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from stereo_gpu.errors import InputError
from stereo_gpu.files import check_writable

LIST_NAME = "pairs.jsonl"
PICTURE = re.compile(r"(?:left|right)([0-9]{4,9})\.png")
HIDDEN = re.compile(r"\.(?:left|right)([0-9]{4,9})\.png\.part")
SYNC_EVERY_S = 1.0  # the list reaches the disk so often; a program that is killed loses nothing, a computer might

logger = logging.getLogger(__name__)


class PairFolder:
    """The folder that a recording goes to; made if missing, and removed again if it gets no pair.

    Raises:
        InputError: it cannot be written, another recording writes to it, or its list is none.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.path = Path(folder)
        check_writable(self.path)
        self._made = [part for part in (self.path, *self.path.parents) if not part.exists()]
        self._list = self.path / LIST_NAME
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._stream = os.open(self._list, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o666)
        except OSError as error:
            raise self._cannot_write(self._list, error) from error
        try:
            self._lock()
            self._finish_what_was_cut_off()
            self._next = self._highest_number() + 1
        except BaseException as error:
            os.close(self._stream)
            if isinstance(error, OSError):
                raise self._cannot_write(self.path, error) from error
            raise
        self._synced_s = 0.0

    def next_number(self) -> int:
        """The number of the next pair; every call gives another one."""
        self._next += 1
        return self._next - 1

    def names(self, number: int) -> tuple[str, str]:
        """The left and right picture's name."""
        return f"left{number:04d}.png", f"right{number:04d}.png"

    def write_hidden(self, number: int, left: bytes, right: bytes) -> None:
        """Write both files of a pair under hidden names, down to the disk; may be called from several threads.

        Raises:
            InputError: the disk is full, or the folder cannot be written any more.
        """
        for name, data in zip(self.names(number), (left, right), strict=True):
            hidden = self._hidden(name)
            try:
                with hidden.open("xb") as stream:
                    stream.write(data)
                    stream.flush()
                    os.fsync(stream.fileno())
            except OSError as error:
                raise self._cannot_write(self.path / name, error) from error

    def reveal(self, number: int, record: dict[str, Any]) -> None:
        """Give both files their names, then add the pair's line to the list.

        Raises:
            InputError: the disk is full, or the folder cannot be written any more; the pair is not there then.
        """
        names = self.names(number)
        line = json.dumps({"number": number, "left": names[0], "right": names[1], **record}, ensure_ascii=False)
        try:
            for name in names:
                self._hidden(name).rename(self.path / name)
            self._append(line.encode("utf-8", "backslashreplace") + b"\n")
        except OSError as error:
            for name in names:
                with suppress(OSError):  # the whole disk may be gone
                    (self.path / name).unlink(missing_ok=True)
            self.forget(number)
            raise self._cannot_write(self._list, error) from error

    def forget(self, number: int) -> None:
        """Leave no hidden file of a pair, as of one that is not to be."""
        left, right = (self.path / name for name in self.names(number))
        hidden_left, hidden_right = self._hidden(left.name), self._hidden(right.name)
        with suppress(OSError):
            # Ended between the two names: both files are whole, and the right one still lacks its name.
            if hidden_right.exists() and left.exists() and not right.exists():
                hidden_right.rename(right)
            hidden_left.unlink(missing_ok=True)
            hidden_right.unlink(missing_ok=True)

    def close(self) -> None:
        """Let the folder go; remove what was made in vain."""
        with suppress(OSError):
            os.fsync(self._stream)
        empty = os.fstat(self._stream).st_size == 0
        os.close(self._stream)
        if empty:
            with suppress(OSError):
                self._list.unlink(missing_ok=True)
            for part in self._made:
                with suppress(OSError):  # it may hold something else by now
                    part.rmdir()

    def _hidden(self, name: str) -> Path:
        return self.path / f".{name}.part"

    def _append(self, line: bytes) -> None:
        """Add a line whole or not at all."""
        before = os.fstat(self._stream).st_size
        try:
            written = os.write(self._stream, line)
            if written < len(line):  # a disk that fills up takes a part
                written += os.write(self._stream, line[written:])
            if time.monotonic() - self._synced_s > SYNC_EVERY_S:
                os.fsync(self._stream)
                self._synced_s = time.monotonic()
        except OSError:
            with suppress(OSError):
                os.ftruncate(self._stream, before)
            raise

    def _lock(self) -> None:
        """Keep a second recording out until this one ends, however it ends."""
        try:
            import fcntl
        except ImportError:  # Windows
            return
        try:
            fcntl.flock(self._stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise InputError(f"another recording writes to {self.path}: wait for it or name another folder") from error
        except OSError:  # a file system that knows no locks
            logger.info("%s cannot be locked: do not record to it twice at once", self.path)

    def _finish_what_was_cut_off(self) -> None:
        """Clear away what a run that was killed left half done."""
        for file in list(self.path.iterdir()):
            if found := HIDDEN.fullmatch(file.name):
                self.forget(int(found[1]))
        data = self._list.read_bytes()
        end = data.rfind(b"\n") + 1
        if end < len(data):  # the computer itself went down
            os.ftruncate(self._stream, end)
            logger.warning("%s: its last line was cut off and is removed", self._list)

    def _highest_number(self) -> int:
        numbers = [int(found[1]) for file in self.path.iterdir() if (found := PICTURE.fullmatch(file.name))]
        for count, line in enumerate(self._list.read_bytes().splitlines(), 1):
            try:
                number = json.loads(line)["number"]
                numbers.append(int(number))
            except (ValueError, TypeError, KeyError, RecursionError, OverflowError) as error:
                raise InputError(
                    f"{self._list} is no list of pairs (line {count}): name another folder, or move it away"
                ) from error
        return max(numbers, default=0)

    def _cannot_write(self, path: Path, error: OSError) -> InputError:
        return InputError(f"cannot write {path}: {error.strerror or error}; free some room or name another folder")
