"""Answers a browser on this computer: the page, its state and small pictures; nothing else, and to nobody else."""

from __future__ import annotations

import logging
import socket
import socketserver
import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any, Protocol

from stereo_gpu.errors import InputError

LOCAL = "127.0.0.1"
LOCAL_ADDRESSES = (LOCAL, "localhost", "::1")
LOCAL_NAMES = {"localhost", "127.0.0.1", "[::1]"}
USUAL_PORT = 8765
IDLE_S = 10.0  # a connection on which nothing moves for so long is closed
MOST_CONNECTIONS = 24
PICTURES = {"/left.jpg": 0, "/right.jpg": 1}

logger = logging.getLogger(__name__)


class Content(Protocol):
    """What is shown."""

    def state(self) -> bytes:
        """What the page draws, as JSON."""
        ...

    def picture(self, side: int, number: int | None) -> bytes | None:
        """JPEG of the moment of this number; None where there is none."""
        ...

    def thumbnail(self, number: int, side: int) -> bytes | None:
        """Small JPEG of a pair; None where there is none."""
        ...


class PageServer(ThreadingHTTPServer):
    """A thread a connection, up to a limit; what comes beyond it is hung up on."""

    daemon_threads = True
    allow_reuse_address = True
    request_queue_size = 16

    def __init__(self, address: tuple[str, int], content: Content) -> None:
        self.host, self.content = address[0], content
        self.address_family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
        self._free = threading.BoundedSemaphore(MOST_CONNECTIONS)
        super().__init__(address, _Handler)

    def server_bind(self) -> None:
        """Bind without asking the network for this computer's name, which may take long."""
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = str(self.server_address[0]), int(self.server_address[1])

    def process_request(self, request: Any, client_address: Any) -> None:
        """Give the connection a thread, or hang up."""
        if not self._free.acquire(blocking=False):
            self.shutdown_request(request)
            return
        try:
            super().process_request(request, client_address)
        except BaseException:
            self._free.release()
            raise

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer in that thread, and make room for another one."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Keep it off the terminal: clients hang up in the middle of a picture all the time."""
        logger.debug("page: a connection from %s failed", client_address, exc_info=True)


class _Handler(BaseHTTPRequestHandler):
    """Answers GET for a handful of fixed paths; nothing is read from the disk by a client's word."""

    protocol_version = "HTTP/1.1"
    timeout = IDLE_S
    server: PageServer

    def do_GET(self) -> None:
        """Send the page, its state or a picture."""
        path, _, query = self.path.partition("?")
        if not self._addressed_here():
            self.send_error(HTTPStatus.FORBIDDEN, "this page is open to this computer alone")
            return
        content = self.server.content
        body: bytes | None
        kind = "image/jpeg"
        if path == "/":
            body, kind = _page(), "text/html; charset=utf-8"
        elif path == "/state.json":
            body, kind = content.state(), "application/json"
        elif path in PICTURES:
            body = content.picture(PICTURES[path], _whole(query.removeprefix("n=")))
        else:
            body = self._thumbnail(path)
        if body is None:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def end_headers(self) -> None:
        """Keep other pages, frames and caches off the cameras' pictures."""
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        self.send_header("X-Frame-Options", "DENY")
        super().end_headers()

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing on the terminal, which has a map to draw."""

    def _thumbnail(self, path: str) -> bytes | None:
        """Of a path such as /pair/3/left.jpg."""
        _, _, rest = path.partition("/pair/")
        number, _, name = rest.partition("/")
        side, wanted = PICTURES.get(f"/{name}"), _whole(number)
        return None if side is None or wanted is None else self.server.content.thumbnail(wanted, side)

    def _addressed_here(self) -> bool:
        """Whether the browser was told to come here by name: a foreign page may point a name of its own at us."""
        if self.server.host not in LOCAL_ADDRESSES:
            return True
        host = self.headers.get("Host", "")
        name = host if host.endswith("]") else host.rpartition(":")[0] or host
        return name.lower() in LOCAL_NAMES


def parse_address(text: str) -> tuple[str, int]:
    """Read a port such as "8765", or an address and a port such as "0.0.0.0:8765".

    Raises:
        InputError: the text is no such thing.
    """
    host, _, port = text.strip().rpartition(":")
    number = _whole(port)
    if number is None or number > 65535:
        raise InputError(f"page {text!r:.60}: give a port such as {USUAL_PORT}, or an address and a port")
    return host.strip("[]") or LOCAL, number


def listen(host: str, port: int | None, content: Content) -> PageServer:
    """A server that does not serve yet, at the port, or where that is None at 8765 or any that is free.

    Raises:
        InputError: the address or port cannot be had.
    """
    for wanted in (USUAL_PORT, 0) if port is None else (port,):
        try:
            return PageServer((host, wanted), content)
        except OSError as error:
            failed, reason = wanted, error.strerror or str(error)
        except (OverflowError, UnicodeError) as error:
            failed, reason = wanted, str(error)
    raise InputError(f"no page at {host}:{failed}: {reason}; give another port with --page, 0 for any, or --no-page")


def _page() -> bytes:
    """The page itself, complete but for what it asks for here."""
    look = files("stereo_gpu").joinpath("report.css").read_text("utf-8")
    return files("stereo_gpu.recording").joinpath("live_page.html").read_text("utf-8").replace("$css", look).encode()


def _whole(text: str) -> int | None:
    return int(text) if text.isascii() and text.isdigit() and len(text) < 12 else None
