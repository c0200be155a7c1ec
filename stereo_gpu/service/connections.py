"""Connections that neither crowd out the others nor stay for nothing: what uvicorn leaves open is closed here."""

from __future__ import annotations

import asyncio
import json
from http import HTTPStatus
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

STALL_S = 60.0  # without a byte taken by a client that is being sent something
MOST_HEADERS = 100
FREE_CHUNKS = 1000  # of a body, whatever their size
LEAST_CHUNK = 256  # bytes of those beyond, on average
NO_HTTP = "this is no HTTP/1.1 request, or its header is too long: send one"
BUSY = "the service has as many connections as it can hold: try again in a moment"


class GuardedProtocol(H11Protocol):
    """HTTP/1.1 with bounds on what a client may hold without asking anything.

    - A connection that has sent no whole request header after `header_seconds` is closed, from its start or from the
      first byte after an answer. The rest of a body that was refused counts as such bytes.
    - A body in chunks of a few bytes is no HTTP here: a chunk costs as much to read as a page of plain body.
    - A client that takes none of its answer for STALL_S is cut off.
    - Connections beyond `most` are answered 503 at once.

    Args:
        header_seconds, most: these bounds.
    """

    def __init__(self, *args: Any, header_seconds: float, most: int, **keywords: Any) -> None:
        super().__init__(*args, **keywords)
        most_bytes = self.config.h11_max_incomplete_event_size
        assert most_bytes is not None
        self.conn = _Connection(h11.SERVER, most_bytes)
        self._header_seconds = header_seconds
        self._most = most
        self._header_timer: asyncio.TimerHandle | None = None
        self._stall_timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take or refuse it."""
        super().connection_made(transport)
        if len(self.connections) > self._most:
            transport.write(_answer(503, BUSY, "retry-after: 5"))
            transport.close()
            return
        self._watch()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget it."""
        super().connection_lost(exc)
        for timer in (self._header_timer, self._stall_timer):
            if timer is not None:
                timer.cancel()

    def data_received(self, data: bytes) -> None:
        """Take what came."""
        if self.transport.is_closing():
            return
        super().data_received(data)
        self._watch()

    def send_400_response(self, msg: str) -> None:
        """Answer what is no HTTP, and hear no more; in the middle of another answer there is nothing to say."""
        cycle = self.cycle
        answering = cycle is not None and cycle.response_started and not cycle.response_complete
        if cycle is not None:
            # Whoever works on a request whose body has turned out to be broken hears of it.
            cycle.disconnected = True
            cycle.message_event.set()
        if not answering:
            self.transport.write(_answer(400, NO_HTTP))
        self.transport.close()

    def pause_writing(self) -> None:
        """The client takes its answer more slowly than it is made."""
        super().pause_writing()
        self._await_progress(self.transport.get_write_buffer_size())

    def resume_writing(self) -> None:
        """It has caught up."""
        super().resume_writing()
        if self._stall_timer is not None:
            self._stall_timer.cancel()
            self._stall_timer = None

    def _watch(self) -> None:
        """Bound the time until there is a request, unless one is being worked on."""
        working = self.cycle is not None and not self.cycle.response_complete
        if working and self._header_timer is not None:
            self._header_timer.cancel()
            self._header_timer = None
        elif not working and self._header_timer is None:
            self._header_timer = self.loop.call_later(self._header_seconds, self._give_up)

    def _give_up(self) -> None:
        self._header_timer = None
        if self.cycle is not None and not self.cycle.response_complete:
            return  # a request began by what was held back while another was answered
        self.transport.close()

    def _await_progress(self, left: int) -> None:
        self._stall_timer = self.loop.call_later(STALL_S, self._look_for_progress, left)

    def _look_for_progress(self, before: int) -> None:
        left = self.transport.get_write_buffer_size()
        if left >= before:
            self.transport.abort()  # to close it would wait for the client, who takes nothing
        else:
            self._await_progress(left)


class _Connection(h11.Connection):
    """Counts the headers of a request, and the chunks of its body."""

    def next_event(self) -> Any:
        event = super().next_event()
        if isinstance(event, h11.Request):
            self._chunks = self._bytes = 0
            if len(event.headers) > MOST_HEADERS:
                raise h11.RemoteProtocolError("too many headers")
        elif isinstance(event, h11.Data):
            self._chunks += bool(event.chunk_start)
            self._bytes += len(event.data)
            if self._chunks > FREE_CHUNKS + self._bytes // LEAST_CHUNK:
                raise h11.RemoteProtocolError("chunks of a few bytes each")
        return event


def _answer(status: int, detail: str, *headers: str) -> bytes:
    """A whole answer, for where no app is asked."""
    title = HTTPStatus(status).phrase
    body = json.dumps({"type": "about:blank", "title": title, "status": status, "detail": detail})
    lines = (
        f"HTTP/1.1 {status} {title}",
        "content-type: application/problem+json",
        f"content-length: {len(body)}",
        "cache-control: no-store",
        "x-content-type-options: nosniff",
        "connection: close",
        *headers,
    )
    return ("\r\n".join(lines) + f"\r\n\r\n{body}").encode()
