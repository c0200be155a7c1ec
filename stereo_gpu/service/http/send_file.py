"""A file as an answer: its sha256 as the ETag, one range of it where that is asked for (RFC 9110, 13 and 14)."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import BinaryIO

from anyio.to_thread import run_sync
from starlette.datastructures import Headers
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from stereo_gpu.service.problems import answer_problem
from stereo_gpu.service.refusals import NotFound

CHUNK = 1 << 18
# What a browser has it may show again, once it has asked whether it is still the same.
CACHE = "private, no-cache"

_RANGE = re.compile(r"bytes=(\d{0,18})-(\d{0,18})", re.ASCII | re.IGNORECASE)


class FileAnswer(Response):
    """A file that does not change: 200, 206, 304 or 416.

    Args:
        path: of the file.
        media_type: of its content.
        etag: what it is told apart by, without quotes.
        download: its name on the client's disk; None for a picture that is shown.

    Raises:
        NotFound: it is not there any more.
    """

    def __init__(self, path: Path, *, media_type: str, etag: str, download: str | None = None) -> None:
        try:
            # Opened now: a job that is deleted while its file is being sent does not cut it off.
            self._file: BinaryIO = path.open("rb")
        except FileNotFoundError:
            raise NotFound(f"{path.name!r:.60}: there is no such file; the list of files says what there is") from None
        self._size = os.fstat(self._file.fileno()).st_size
        self._etag = f'"{etag}"'
        headers = {"accept-ranges": "bytes", "etag": self._etag, "cache-control": CACHE}
        if download is not None:
            headers["content-disposition"] = f'attachment; filename="{download}"'
        super().__init__(headers=headers, media_type=media_type)
        del self.headers["content-length"]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send what was asked for."""
        try:
            await self._send(scope, receive, send)
        finally:
            self._file.close()

    async def _send(self, scope: Scope, receive: Receive, send: Send) -> None:
        asked = Headers(scope=scope)
        if _names(asked.get("if-none-match", ""), self._etag):
            self.status_code = 304
            await self._head(send, 0)
            return
        part = None
        # Only a GET has parts (RFC 9110, 14.2): HEAD tells of the whole.
        if scope["method"] == "GET" and "range" in asked and asked.get("if-range", self._etag) == self._etag:
            part = find_range(asked["range"], self._size)
        if part is not None and part[0] >= part[1]:
            said = f"range {asked['range']!r:.60} lies outside of {self._size} bytes: ask for a part of them"
            problem = answer_problem(416, said, {"Content-Range": f"bytes */{self._size}"})
            await problem(scope, receive, send)
            return
        begin, end = part or (0, self._size)
        if part is not None:
            self.status_code = 206
            self.headers["content-range"] = f"bytes {begin}-{end - 1}/{self._size}"
        await self._head(send, end - begin)
        if scope["method"] != "HEAD":
            await self._body(send, begin, end)
        else:
            await send({"type": "http.response.body", "body": b""})

    async def _head(self, send: Send, length: int) -> None:
        if self.status_code != 304:
            self.headers["content-length"] = str(length)
        await send({"type": "http.response.start", "status": self.status_code, "headers": self.raw_headers})
        if self.status_code == 304:
            await send({"type": "http.response.body", "body": b""})

    async def _body(self, send: Send, begin: int, end: int) -> None:
        self._file.seek(begin)
        left = end - begin
        while left:
            data = await run_sync(self._file.read, min(CHUNK, left))
            if not data:
                raise OSError(f"{self._file.name} has become shorter")
            left -= len(data)
            await send({"type": "http.response.body", "body": data, "more_body": left > 0})
        if end == begin:
            await send({"type": "http.response.body", "body": b""})


def find_range(asked: str, size: int) -> tuple[int, int] | None:
    """The bytes from and up to which a Range header asks, of a file of `size`; empty where it has none of them.

    None for the whole file: where there are several ranges, another unit, or nonsense, which RFC 9110 lets a server
    ignore.
    """
    found = _RANGE.fullmatch(asked.strip())
    if found is None or not any(found.groups()):
        return None
    first, last = found.groups()
    if not first:
        return max(0, size - int(last)), size if int(last) else 0
    if last and int(last) < int(first):
        return None
    return int(first), min(size, int(last) + 1) if last else size


def _names(header: str, etag: str) -> bool:
    """Whether an If-None-Match names this ETag; weak ones compare alike."""
    return header.strip() == "*" or etag in (each.strip().removeprefix("W/") for each in header.split(","))
