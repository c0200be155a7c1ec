"""Connections that neither crowd out the others nor stay for nothing: what uvicorn leaves open is closed here."""

from __future__ import annotations

import asyncio
import json
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

STALL_S = 60.0  # without a byte taken by a client that is being sent something
BUSY = json.dumps(
    {
        "type": "about:blank",
        "title": "Service Unavailable",
        "status": 503,
        "detail": "the service has as many connections as it can hold: try again in a moment",
    }
).encode()
BUSY_ANSWER = (
    b"HTTP/1.1 503 Service Unavailable\r\ncontent-type: application/problem+json\r\nretry-after: 5\r\n"
    b"connection: close\r\ncontent-length: %d\r\n\r\n%s" % (len(BUSY), BUSY)
)


class GuardedProtocol(H11Protocol):
    """HTTP/1.1 with bounds on what a client may hold without asking anything.

    - A connection that has sent no whole request header after `header_seconds` is closed, from its start or from the
      first byte after an answer. The rest of a body that was refused counts as such bytes.
    - A client that takes none of its answer for STALL_S is cut off.
    - Connections beyond `most` are answered 503 at once.

    Args:
        header_seconds, most: these bounds.
    """

    def __init__(self, *args: Any, header_seconds: float, most: int, **keywords: Any) -> None:
        super().__init__(*args, **keywords)
        self._header_seconds = header_seconds
        self._most = most
        self._header_timer: asyncio.TimerHandle | None = None
        self._stall_timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take or refuse it."""
        super().connection_made(transport)
        if len(self.connections) > self._most:
            transport.write(BUSY_ANSWER)
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
