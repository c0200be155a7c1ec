"""Receive a form with pictures: streamed to the disk, looked at, named by the server, removed unless it is kept."""

from __future__ import annotations

import asyncio
from contextlib import aclosing
from pathlib import Path
from types import TracebackType
from typing import Self

from fastapi import Request
from python_multipart.multipart import parse_options_header

from stereo_gpu.errors import InputError
from stereo_gpu.service.data.folders import Folders
from stereo_gpu.service.intake.multipart import FileWanted, FormSpec, FormWriter, Received, check_room
from stereo_gpu.service.intake.sniff import SUFFIXES, look
from stereo_gpu.service.intake.upload_stream import stream_body
from stereo_gpu.service.problems import Problem
from stereo_gpu.service.records import InputFile
from stereo_gpu.service.settings import MEGABYTE, Settings

AT_ONCE = 1 << 18  # bytes that are handed to a thread together: less would be all handing over
KIND = b"multipart/form-data"
LONGEST_BOUNDARY = 70  # RFC 2046


class Form:
    """A form that was received.

    A context manager: the upload is removed at the end of the block, unless `keep` was called.

    Attributes:
        folder: where the files lie, by the names that `files` tells; for `Folders.accept`.
        fields: text of the other fields.
        files: by field, in the order in which they came.
    """

    def __init__(self, folder: Path, fields: dict[str, str], files: dict[str, list[InputFile]], writer: FormWriter):
        self.folder = folder
        self.fields = fields
        self.files = files
        self._writer = writer
        self._kept = False

    @property
    def inputs(self) -> tuple[InputFile, ...]:
        """All files."""
        return tuple(file for files in self.files.values() for file in files)

    @property
    def bytes(self) -> int:
        """Of all files."""
        return sum(file.size for file in self.inputs)

    def path(self, file: InputFile) -> Path:
        """Where it lies until the form is accepted."""
        return self.folder / file.name

    def keep(self) -> None:
        """Say that the folder has been accepted, and is not to be removed."""
        self._kept = True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not self._kept:
            self._writer.give_up()


async def receive_form(request: Request, folders: Folders, settings: Settings, wanted: FormSpec) -> Form:
    """Receive a form into a folder of its own.

    Whatever goes wrong, that folder is removed: an error below, a client that goes away, a stop of the service.

    Raises:
        Problem: it is no form, damaged, cut off, too large, too slow, or there is no room for it.
        InputError: it holds what is not wanted, lacks what is, or a picture is none that is taken.
    """
    boundary = _boundary(request)
    spare = int(settings.spare_gb * (1 << 30))
    check_room(settings.data, spare)
    folder = folders.new_upload()
    writer = FormWriter(boundary, folder, wanted, file_bytes=settings.file_mb * MEGABYTE, spare_bytes=spare)
    try:
        rest = await _receive(request, settings, writer)
        files = await asyncio.to_thread(_take_in, writer, rest, wanted, settings)
    except BaseException:
        # Not in a thread: this may be a cancellation, which nothing that is awaited would outlive.
        writer.give_up()
        raise
    return Form(folder, writer.fields, files, writer)


def _boundary(request: Request) -> bytes:
    kind, options = parse_options_header(request.headers.get("content-type"))
    if kind != KIND:
        raise Problem(415, f"the body is of type {kind.decode('latin-1')!r:.60}: send multipart/form-data")
    boundary = options.get(b"boundary", b"")
    if not 1 <= len(boundary) <= LONGEST_BOUNDARY:
        raise Problem(400, f"the form has a boundary of {len(boundary)} characters: give 1 to {LONGEST_BOUNDARY}")
    return boundary


async def _receive(request: Request, settings: Settings, writer: FormWriter) -> bytes:
    """Feed the writer; gives the last bytes, which are still to be fed."""
    held = bytearray()
    async with aclosing(stream_body(request, settings, settings.request_mb * MEGABYTE)) as stream:
        async for part in stream:
            held += part
            if len(held) >= AT_ONCE:
                await asyncio.to_thread(writer.feed, bytes(held))
                held.clear()
    return bytes(held)


def _take_in(writer: FormWriter, rest: bytes, wanted: FormSpec, settings: Settings) -> dict[str, list[InputFile]]:
    """Feed what is left, check that all is there, look at the pictures, and give the files their names."""
    writer.feed(rest)
    if not writer.complete:
        raise Problem(400, "the form is cut off: send it again")
    for name in wanted.required:
        if name not in writer.fields:
            raise InputError(f"{name} is missing: give it")
    files: dict[str, list[InputFile]] = {}
    for name, some in wanted.files.items():
        received = [file for file in writer.files if file.field == name]
        if len(received) < some.least:
            raise InputError(f"{name} is missing: send {some.least} file{'s' if some.least > 1 else ''} of that name")
        files[name] = [_name(file, number, some, settings) for number, file in enumerate(received)]
    return files


def _name(file: Received, number: int, wanted: FileWanted, settings: Settings) -> InputFile:
    called = file.field + (f" {number + 1}" if wanted.most > 1 else "") + (f" ({file.given})" if file.given else "")
    if file.size == 0:
        raise InputError(f"{called} is empty: send it again")
    width = height = 0
    suffix = ""
    if wanted.picture:
        form, width, height = look(file.path, settings, name=called)
        suffix = SUFFIXES[form]
    name = file.field + (f"{number:03d}" if wanted.most > 1 else "") + suffix
    file.path.rename(file.path.with_name(name))
    return InputFile(name=name, given=file.given, sha256=file.sha256, size=file.size, width=width, height=height)
