"""A job as it changes: server-sent events, from the threads that change it to the connections that wait."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable, Iterator

from anyio.to_thread import run_sync

from stereo_gpu.service.http.models import JobView
from stereo_gpu.service.live import Live
from stereo_gpu.service.problems import Problem
from stereo_gpu.service.records import State

MEDIA_TYPE = "text/event-stream"
COMMENT_S = 10.0  # so that a proxy keeps the connection, and both ends see when it is gone
PLACE_S = 1.0  # between two events of a job that only moved up in the queue, which all of its streams hear of
MOST_EACH = 128  # streams of one client: all connections together are some hundred, and others need some
LEAST_S = 0.1  # between two events: stages of a small job are shorter than an eye or a connection can follow


class Streams:
    """All open streams, so that a stop can end them; used from one event loop, but for `stop`."""

    def __init__(self) -> None:
        self.stopping = False
        self._bells: set[_Bell] = set()

    def stop(self) -> None:
        """End every stream after what it has to say now; from any thread."""
        self.stopping = True
        for bell in tuple(self._bells):
            bell.ring()

    def check_room(self, client: str) -> None:
        """Refuse a client that has as many streams open as one may have.

        Raises:
            Problem: with 429.
        """
        if sum(bell.client == client for bell in self._bells) >= MOST_EACH:
            said = f"{MOST_EACH} streams of yours are open, which is the limit: close some, or ask for the list of jobs"
            raise Problem(429, said, {"Retry-After": "5"})

    @contextlib.contextmanager
    def _open(self, live: Live, job: str, client: str) -> Iterator[_Bell]:
        bell = _Bell(client)
        self._bells.add(bell)
        live.subscribe(job, bell.ring)
        try:
            yield bell
        finally:
            live.unsubscribe(job, bell.ring)
            self._bells.discard(bell)

    async def follow(
        self, live: Live, job: str, look: Callable[[], JobView | None], first: int, client: str = ""
    ) -> AsyncIterator[bytes]:
        """The events of a job: one at once, one whenever it has changed, a comment where nothing has.

        Args:
            live: rings when it has changed.
            job: its id.
            look: how it is, from the table and `live`; None where it was deleted. Called in a thread.
            first: number of the first event.
            client: whose stream it is, for `check_room`.
        """
        said, number = "", first
        with self._open(live, job, client) as bell:
            while True:
                view = await run_sync(look)
                if view is None:
                    return
                text = view.model_dump_json()
                if text != said:
                    said = text
                    yield f"event: job\nid: {number}\ndata: {text}\n\n".encode()
                    number += 1
                if view.state.ended or self.stopping:
                    return
                await asyncio.sleep(LEAST_S)
                if not await bell.wait(COMMENT_S):
                    yield b": still here\n\n"
                elif view.state is State.QUEUED:
                    await bell.wait_for(lambda: self.stopping or live.has_begun(job), PLACE_S)


class _Bell:
    """Wakes one stream from any thread."""

    def __init__(self, client: str) -> None:
        self.client = client
        self._loop = asyncio.get_running_loop()
        self._rung = asyncio.Event()

    def ring(self) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended, and the stream with it
            self._loop.call_soon_threadsafe(self._rung.set)

    async def wait_for(self, come_true: Callable[[], bool], seconds: float) -> None:
        """Return when it has rung and this is so, or after so long."""
        until = self._loop.time() + seconds
        while not come_true() and (left := until - self._loop.time()) > 0:
            await self.wait(left)

    async def wait(self, seconds: float) -> bool:
        """Whether it rang since it was asked the last time, or rings within so long."""
        try:
            await asyncio.wait_for(self._rung.wait(), seconds)
        except TimeoutError:
            return False
        self._rung.clear()
        return True
