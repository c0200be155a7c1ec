"""A multipart form written to a folder as it comes: limits hold while it streams, hashes are taken on the way."""

from __future__ import annotations

import hashlib
import logging
import shutil
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import BinaryIO

from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header

from stereo_gpu.errors import InputError
from stereo_gpu.service.problems import Problem

MOST_PARTS = 1024
HEADER_BYTES = 4096  # of all headers of a part
SHOWN = 100  # characters of a client's name for a file
FREE_EVERY = 1 << 24  # bytes between two looks at the room on the disk
PLAIN = {b"", b"7bit", b"8bit", b"binary"}  # transfer encodings that change nothing

logging.getLogger("python_multipart").setLevel(logging.ERROR)  # what it warns of, it raises besides


@dataclass(frozen=True, kw_only=True)
class FileWanted:
    """Files of one field of a form.

    Args:
        least, most: how many.
        picture: whether they must be pictures.
    """

    least: int = 1
    most: int = 1
    picture: bool = True


@dataclass(frozen=True, kw_only=True)
class FormSpec:
    """What a form may hold; anything else is refused.

    Args:
        files: by field.
        fields: name of each other field, and how many bytes of text it may have at most.
        required: those of `fields` that must be there.
    """

    files: Mapping[str, FileWanted]
    fields: Mapping[str, int] = field(default_factory=dict)
    required: tuple[str, ...] = ()


@dataclass(kw_only=True)
class Received:
    """A file of the form, as it lies in the folder."""

    field: str
    path: Path
    given: str
    size: int = 0
    sha256: str = ""


class FormWriter:
    """Takes the bytes of a form and leaves its files in a folder.

    It may be fed by one thread while another gives it up: after `give_up` nothing is written any more.

    Args:
        boundary: of the form.
        folder: for its files, which are named 0000, 0001, ... here, whatever the client calls them.
        wanted: what it may hold.
        file_bytes: of one file at most.
        spare_bytes: that must stay free on the disk.
    """

    def __init__(self, boundary: bytes, folder: Path, wanted: FormSpec, *, file_bytes: int, spare_bytes: int) -> None:
        self.fields: dict[str, str] = {}
        self.files: list[Received] = []
        self.complete = False
        self._folder = folder
        self._wanted = wanted
        self._file_bytes = file_bytes
        self._spare_bytes = spare_bytes
        self._until_look = 0
        self._parts = 0
        self._header_bytes = 0
        self._header: tuple[bytearray, bytearray] = (bytearray(), bytearray())
        self._headers: dict[bytes, bytes] = {}
        self._name = ""
        self._text: bytearray | None = None
        self._stream: BinaryIO | None = None
        self._hash = hashlib.sha256()
        self._lock = threading.Lock()
        self._given_up = False
        self._parser = MultipartParser(
            boundary,
            {
                "on_part_begin": self._begin,
                "on_header_field": lambda data, start, end: self._take_header(0, data[start:end]),
                "on_header_value": lambda data, start, end: self._take_header(1, data[start:end]),
                "on_header_end": self._end_header,
                "on_headers_finished": self._open,
                "on_part_data": self._take,
                "on_part_end": self._close,
                "on_end": self._end,
            },
        )

    def feed(self, data: bytes) -> None:
        """Take the next bytes.

        Raises:
            Problem: the form is damaged, too large, or there is no room for it.
            InputError: it holds what is not wanted.
            OSError: the folder cannot be written.
        """
        with self._lock:
            if self._given_up:
                return
            try:
                self._parser.write(data)
            except FormParserError as error:
                raise Problem(400, f"the form is damaged: {_line(error)}; send it as multipart/form-data") from None

    def give_up(self) -> None:
        """Remove the folder and all that is in it."""
        with self._lock:
            self._given_up = True
            if self._stream is not None:
                self._stream.close()
            shutil.rmtree(self._folder, ignore_errors=True)

    def _begin(self) -> None:
        self._parts += 1
        if self._parts > MOST_PARTS:
            raise Problem(413, f"the form has over {MOST_PARTS} parts: send fewer at once")
        self._header_bytes = 0
        self._headers = {}
        self._header = (bytearray(), bytearray())

    def _take_header(self, which: int, data: bytes) -> None:
        self._header_bytes += len(data)
        if self._header_bytes > HEADER_BYTES:
            raise Problem(400, f"the headers of a part have over {HEADER_BYTES} bytes: send shorter names")
        self._header[which].extend(data)

    def _end_header(self) -> None:
        name, value = (bytes(part) for part in self._header)
        if name.lower() in self._headers:
            raise Problem(400, f"a part has the header {name.decode('ascii', 'replace')!r:.40} twice: send it once")
        self._headers[name.lower()] = value
        self._header = (bytearray(), bytearray())

    def _open(self) -> None:
        kind, options = parse_options_header(self._headers.get(b"content-disposition", b"").decode("latin-1"))
        if kind != b"form-data" or b"name" not in options:
            raise Problem(400, "a part of the form has no name: send it as multipart/form-data")
        if self._headers.get(b"content-transfer-encoding", b"").strip().lower() not in PLAIN:
            raise Problem(400, "a part of the form is encoded: send its bytes as they are")
        self._name = name = options[b"name"].decode("utf-8", "replace")
        if name in self._wanted.files:
            self._open_file(name, options.get(b"filename", b"").decode("utf-8", "replace"))
        elif name in self._wanted.fields:
            if name in self.fields:
                raise InputError(f"{name} is given twice: give it once")
            self._text = bytearray()
        else:
            known = ", ".join((*self._wanted.files, *self._wanted.fields))
            raise InputError(f"{name!r:.60} is no field of this form: send {known}")

    def _open_file(self, name: str, given: str) -> None:
        most = self._wanted.files[name].most
        if sum(file.field == name for file in self.files) >= most:
            raise InputError(f"{name} has over {most} file{'s' if most > 1 else ''}: send no more than that")
        path = self._folder / f"{len(self.files):04d}"
        self._stream = path.open("xb")
        self._hash = hashlib.sha256()
        self.files.append(Received(field=name, path=path, given=shown_name(given)))

    def _take(self, data: bytes, start: int, end: int) -> None:
        if self._text is not None:
            self._text.extend(memoryview(data)[start:end])
            most = self._wanted.fields[self._name]
            if len(self._text) > most:
                raise InputError(f"{self._name} has over {most} bytes: shorten it")
        elif self._stream is not None:
            file = self.files[-1]
            file.size += end - start
            if file.size > self._file_bytes:
                raise Problem(
                    413,
                    f"{file.field} is larger than {self._file_bytes >> 20} MB, which is the limit here: scale it down",
                )
            self._look_for_room(end - start)
            part = memoryview(data)[start:end]
            self._hash.update(part)
            self._stream.write(part)

    def _look_for_room(self, size: int) -> None:
        self._until_look -= size
        if self._until_look < 0:
            self._until_look = FREE_EVERY
            check_room(self._folder, self._spare_bytes)

    def _close(self) -> None:
        if self._text is not None:
            try:
                self.fields[self._name] = self._text.decode()
            except UnicodeDecodeError:
                raise InputError(f"{self._name} is no UTF-8: send it as UTF-8") from None
            self._text = None
        elif self._stream is not None:
            self._stream.close()
            self._stream = None
            self.files[-1].sha256 = self._hash.hexdigest()

    def _end(self) -> None:
        self.complete = True


def check_room(folder: Path, spare_bytes: int) -> None:
    """Refuse what would fill the disk.

    Raises:
        Problem: less than `spare_bytes` are free.
    """
    if shutil.disk_usage(folder).free < spare_bytes:
        raise Problem(507, "the disk of the service is full: delete jobs, or try again later", {"Retry-After": "60"})


def shown_name(given: str) -> str:
    """A client's name for a file without its folders, cut to what can be shown; never used as a path."""
    name = PurePosixPath(given.replace("\\", "/")).name
    return "".join(letter for letter in name if letter.isprintable())[:SHOWN]


def _line(error: Exception) -> str:
    text = " ".join(str(error).split())
    return text[:1].lower() + text[1:]
