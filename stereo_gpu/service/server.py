"""Serve until a signal: uvicorn with bounds on every connection, and a stop in order."""

from __future__ import annotations

import asyncio
import errno
import ipaddress
import logging
import signal
import socket
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from functools import partial
from types import FrameType

import uvicorn
from fastapi import FastAPI

from stereo_gpu.errors import InputError
from stereo_gpu.service.connections import GuardedProtocol
from stereo_gpu.service.http.app import create_app
from stereo_gpu.service.service import Service
from stereo_gpu.service.settings import Settings

HEADER_SECONDS = 10.0  # until a request's header is there
KEEP_ALIVE_S = 15
HEADER_BYTES = 16 << 10  # of a request line and all of its headers
MOST_CONNECTIONS = 512
FILES_A_CONNECTION = 2  # the socket, and what is written or sent
FILES_BESIDES = 128
WAITING = 256  # connections that the system holds until they are taken
LAST_TURNS = 5  # of the loop, in which connections that were closed or taken last are let go of
CLOSING_S = 5  # for answers under way, once the jobs have had their grace
SIGNALS = (signal.SIGINT, signal.SIGTERM)

log = logging.getLogger("stereo_gpu.service")


def listen(settings: Settings) -> socket.socket:
    """Take the port before anything else is done.

    Raises:
        InputError: the port is another program's, or the host is none of this machine.
    """
    host, port = settings.host, settings.port
    if not 0 <= port <= 65535:
        raise InputError(f"port {port}: give 1 to 65535, or 0 for any that is free")
    try:
        family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0]
    except (OSError, UnicodeError) as error:
        raise InputError(f"host {host!r:.60}: {error}; give an address of this machine, such as 127.0.0.1") from None
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen(WAITING)
    except OSError as error:
        listener.close()
        if error.errno == errno.EADDRINUSE:
            raise InputError(f"port {port} of {host} is in use: end what has it, or give another --port") from None
        raise InputError(
            f"cannot listen at {host} port {port}: {error.strerror}; give another --host or --port"
        ) from None
    if not is_loopback(listener):
        log.warning(
            "it listens at %s, beyond this machine, and what is sent there is not encrypted: put a proxy with TLS"
            " before it (docs/operations.md)",
            address_of(listener),
        )
    return listener


def address_of(listener: socket.socket) -> str:
    """Where it listens, as a browser takes it."""
    host, port = listener.getsockname()[:2]
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


def is_loopback(listener: socket.socket) -> bool:
    """Whether only this machine reaches it."""
    return ipaddress.ip_address(listener.getsockname()[0].partition("%")[0]).is_loopback


def serve(
    service: Service,
    settings: Settings,
    listener: socket.socket | None = None,
    ready: Callable[[str], None] | None = None,
) -> None:
    """Serve over HTTP until SIGTERM or SIGINT, then close the service.

    A stop goes in order: no new jobs are taken and /readyz says 503; jobs that have begun get `grace_seconds`, the
    rest stays queued; streams and answers end; workers end. A second signal takes what is left of the grace away.

    Args:
        service: opened; it is closed when this returns, however it returns.
        settings: of the service.
        listener: what `listen` gave; None takes the port now.
        ready: told the address once it answers there.

    Raises:
        InputError: as `listen`.
    """
    try:
        listener = listener or listen(settings)
        app = create_app(service)
        _Server(configure(app), service, app.state.streams.stop, ready).run([listener])
    finally:
        service.close(0.0)


def configure(app: FastAPI) -> uvicorn.Config:
    """How uvicorn serves the app; the sockets are its caller's."""
    return uvicorn.Config(
        app,
        http=partial(GuardedProtocol, header_seconds=HEADER_SECONDS, most=_most_connections()),  # type: ignore[arg-type]
        ws="none",
        lifespan="off",
        log_config=None,
        log_level="error",  # it warns of every client that speaks no HTTP
        access_log=False,
        server_header=False,
        proxy_headers=False,
        timeout_keep_alive=KEEP_ALIVE_S,
        timeout_graceful_shutdown=CLOSING_S,
        h11_max_incomplete_event_size=HEADER_BYTES,
    )


class Server(uvicorn.Server):
    """Uvicorn's, which at a stop forgets connections that were being taken just then: it waits for them in vain.

    A browser opens such ones, for it comes back as soon as its stream ends.
    """

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Close the connections that come while it closes the others, too."""
        closing = asyncio.ensure_future(super().shutdown(sockets))
        await asyncio.sleep(0)  # by now it has told those that are there
        told = set(self.server_state.connections)
        while not closing.done():
            await asyncio.wait([closing], timeout=0.05)
            for connection in self.server_state.connections - told:
                told.add(connection)
                connection.shutdown()
        await closing
        for _ in range(LAST_TURNS):
            for connection in self.server_state.connections:
                connection.transport.abort()  # its grace is over, or it came after all others were gone
            await asyncio.sleep(0)


class _Server(Server):
    """Stops the jobs before the connections, and leaves the exit status to its caller."""

    def __init__(
        self,
        config: uvicorn.Config,
        service: Service,
        end_streams: Callable[[], None],
        ready: Callable[[str], None] | None,
    ) -> None:
        super().__init__(config)
        self._service = service
        self._end_streams = end_streams
        self._ready = ready
        self._signals = 0

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        assert sockets is not None
        log.info("serves at %s", address_of(sockets[0]))
        if self._ready is not None:
            self._ready(address_of(sockets[0]))

    @contextmanager
    def capture_signals(self) -> Generator[None]:
        """Uvicorn's own raises the signal again at the end, and the exit status would be that of a crash."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {each: signal.signal(each, self.handle_exit) for each in SIGNALS}
        try:
            yield
        finally:
            for each, handler in before.items():
                signal.signal(each, handler)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Begin to stop; the second time, at once."""
        self._signals += 1
        if self._signals > 2:
            return
        grace_s = self._service.settings.grace_seconds if self._signals == 1 else 0.0
        if self._signals == 2:
            self.force_exit = True
        # In a thread: connections are answered meanwhile, and a signal must not wait for a lock that it interrupted.
        threading.Thread(target=self._stop, args=(sig, grace_s), name="stereo-gpu stop", daemon=True).start()

    def _stop(self, sig: int, grace_s: float) -> None:
        log.info("%s: it stops, jobs under way get %g s", signal.Signals(sig).name, grace_s)
        try:
            self._service.dispatcher.stop(grace_s)
        finally:
            self._end_streams()
            self.should_exit = True


def _most_connections() -> int:
    """So many that files are left for everything else."""
    try:
        import resource
    except ImportError:  # Windows, which has no such limit
        return MOST_CONNECTIONS
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MOST_CONNECTIONS * FILES_A_CONNECTION + FILES_BESIDES
    if soft < wanted:
        with suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (min(wanted, hard) if hard >= 0 else wanted, hard))
        soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return max(8, min(MOST_CONNECTIONS, (soft - FILES_BESIDES) // FILES_A_CONNECTION))
