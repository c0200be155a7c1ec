"""Small bodies: JSON may be neither large nor slow; uploads have their own limits, in uploads.py."""

from __future__ import annotations

import asyncio
from collections.abc import Collection

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from stereo_gpu.service.problems import answer_problem

LARGEST = 1 << 20  # bytes; a mask painted for an hour has a tenth of it


class SmallBodies:
    """Refuses what is too large before it is read, or while it is.

    The framework reads all of a JSON body before it looks for a token, whatever type the body says it is.

    Args:
        app: that reads them.
        seconds: for all of a body.
        uploads: paths whose routes read their bodies themselves, within limits of their own.
    """

    def __init__(self, app: ASGIApp, *, seconds: float, uploads: Collection[str]) -> None:
        self._app = app
        self._seconds = seconds
        self._uploads = frozenset(uploads)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] != "http" or scope["path"] in self._uploads:
            await self._app(scope, receive, send)
            return
        length = Headers(scope=scope).get("content-length", "0")
        if length.isascii() and length.isdigit() and int(length[:20]) > LARGEST:
            await answer_problem(413, _too_large(int(length[:20])))(scope, receive, send)
            return
        counted = _Counted(receive, send, self._seconds)
        await self._app(scope, counted.receive, counted.send)


class _Counted:
    """Bounds a body until the answer begins: what comes while a stream is open is thrown away, and ends nothing."""

    def __init__(self, receive: Receive, send: Send, seconds: float) -> None:
        self._receive = receive
        self._send = send
        self._seconds = seconds
        self._answering = False
        self._bytes = 0
        self._whole = False
        self._until: float | None = None

    async def receive(self) -> Message:
        if self._whole or self._answering:  # from here on it only waits for the connection to end
            return await self._receive()
        now = asyncio.get_running_loop().time()
        self._until = self._until or now + self._seconds
        try:
            message = await asyncio.wait_for(self._receive(), max(0.0, self._until - now))
        except TimeoutError:
            if self._answering:
                return await self._receive()
            # The framework turns any other error of a body into a 400.
            raise HTTPException(408, f"the body took over {self._seconds:g} s: send it at once") from None
        self._whole = message["type"] != "http.request" or not message.get("more_body", False)
        self._bytes += len(message.get("body", b""))
        if self._bytes > LARGEST and not self._answering:
            raise HTTPException(413, _too_large(self._bytes))
        return message

    async def send(self, message: Message) -> None:
        self._answering = True
        await self._send(message)


def _too_large(size: int) -> str:
    return f"the body has {size} bytes or more, the limit is {LARGEST}: send less at once"
