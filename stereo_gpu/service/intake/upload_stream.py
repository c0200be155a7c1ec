"""Read a large body with suspicion: no more than was allowed, and no slower."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator
from contextlib import aclosing

from fastapi import Request
from starlette.requests import ClientDisconnect

from stereo_gpu.service.problems import Problem
from stereo_gpu.service.settings import Settings


async def stream_body(request: Request, settings: Settings, most: int) -> AsyncGenerator[bytes]:
    """Give the body as it comes.

    What `Content-Length` says is refused before anything is read, so that a client which asked first with
    `Expect: 100-continue` sends nothing.

    Raises:
        Problem: it is larger than `most` bytes, comes too slowly, ends too early, or is packed.
    """
    packed = request.headers.get("content-encoding", "identity").strip().lower()
    if packed != "identity":
        raise Problem(415, f"content-encoding {packed!r:.40} is not taken: send the body as it is")
    length = request.headers.get("content-length", "")
    if length.isdecimal() and int(length[:20]) > most:
        raise _too_large(most)
    loop = asyncio.get_running_loop()
    end = loop.time() + settings.upload_seconds
    taken = 0
    async with aclosing(request.stream()) as stream:
        while True:
            idle_end = loop.time() + settings.idle_seconds
            try:
                async with asyncio.timeout_at(min(end, idle_end)):
                    part = await anext(stream, b"")
            except TimeoutError:
                raise _too_slow(settings, idle=idle_end < end) from None
            except ClientDisconnect:
                raise Problem(400, "the connection was lost: send the request again") from None  # for the log alone
            if not part:
                return
            taken += len(part)
            if taken > most:
                raise _too_large(most)
            yield part


def _too_large(most: int) -> Problem:
    size = f"{most >> 20} MB" if most >= 1 << 20 else f"{most} bytes"
    return Problem(413, f"the request is larger than {size}, which is the limit here: send less at once")


def _too_slow(settings: Settings, *, idle: bool) -> Problem:
    if idle:
        detail = f"nothing came for {settings.idle_seconds:g} s: send the request again"
    else:
        detail = f"the request took over {settings.upload_seconds:g} s: send less, or over a faster line"
    # What may still come belongs to no other request.
    return Problem(408, detail, {"Connection": "close"})
