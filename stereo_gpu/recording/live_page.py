"""A page on this computer that shows a capture as it goes: both pictures, the corners, the coverage, what is missing.

The page asks for a small JSON and two small pictures some times a second, so it works through an ssh tunnel. Pictures
are shrunk and encoded only while somebody looks.
"""

from __future__ import annotations

import getpass
import json
import logging
import os
import socket
import socketserver
import threading
import time
from collections import deque
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any

import cv2

from stereo_gpu.calibration.board import Board, BoardView
from stereo_gpu.calibration.coverage import COLUMNS, REGIONS, ROWS
from stereo_gpu.errors import InputError
from stereo_gpu.images import grey
from stereo_gpu.recording.board_watch import Look
from stereo_gpu.recording.quick_find import shrink
from stereo_gpu.types import Bytes

LOCAL = "127.0.0.1"
USUAL_PORT = 8765
SHOWN_SIDE, THUMBNAIL_SIDE = 800, 200  # px
QUALITY = 80  # of JPEG
LOOKS_KEPT = 8  # since a picture is asked for a little later than the JSON that names it
PAIRS_KEPT = 8
CLIENT_S = 5.0  # somebody looks if he has asked for something within so long
LAST_WORD_S = 1.0  # at the end, somebody who looks gets so long to ask once more
IDLE_S = 10.0  # a connection on which nothing moves for so long is closed
MOST_CONNECTIONS = 24
LOCAL_ADDRESSES = (LOCAL, "localhost", "::1")
LOCAL_NAMES = {"localhost", "127.0.0.1", "[::1]"}
PICTURES = {"/left.jpg": 0, "/right.jpg": 1}
AREAS = {  # left, top, right and bottom of the regions, as shares of the picture
    name: [columns.start / COLUMNS, rows.start / ROWS, columns.stop / COLUMNS, rows.stop / ROWS]
    for name, rows, columns in REGIONS
}

logger = logging.getLogger(__name__)


class LivePage:
    """Serves the page from a thread of its own until it is closed.

    Args:
        board: what is watched for.
        host: the address to listen at; only this computer can reach the usual one.
        port: None takes 8765, or any that is free where that is taken; 0 any that is free.

    Raises:
        InputError: the address or port cannot be had.
    """

    def __init__(self, board: Board, *, host: str = LOCAL, port: int | None = None) -> None:
        self._board = board
        self._lock = threading.Lock()
        self._looks: deque[_Shown] = deque(maxlen=LOOKS_KEPT)
        self._pairs: deque[tuple[int, tuple[bytes, bytes]]] = deque(maxlen=PAIRS_KEPT)
        self._newest: Look | None = None
        self._asked_s = float("-inf")
        self._told = 0  # number of the moment that was asked for last
        self._server = _listen(host, port)
        self._server.page = self
        self.host, self.port = host, int(self._server.server_address[1])
        threading.Thread(target=self._server.serve_forever, args=(0.1,), name="live page", daemon=True).start()

    def __enter__(self) -> LivePage:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def url(self) -> str:
        """Where a browser on this computer finds the page."""
        shown = LOCAL if self.host in ("", "0.0.0.0", "::") else self.host
        return f"http://{f'[{shown}]' if ':' in shown else shown}:{self.port}/"

    @property
    def directions(self) -> list[str]:
        """Lines that say how to open the page, through ssh too where this is an ssh session."""
        lines = [f"open {self.url} to see both pictures"]
        if self.host not in LOCAL_ADDRESSES:
            lines.append(f"whoever reaches this computer at port {self.port} can see them too")
        elif os.environ.get("SSH_CONNECTION"):
            own = f"{getpass.getuser()}@{socket.gethostname()}"
            lines.append(f"from the computer before you, first: ssh -L {self.port}:localhost:{self.port} {own}")
        return lines

    def show(self, look: Look) -> None:
        """Take over a look; nobody's slow connection holds this up."""
        with self._lock:
            self._newest = look
            if look.taken:
                small = [_jpeg(_for_screen(picture, THUMBNAIL_SIDE)) for picture in (look.frame.left, look.frame.right)]
                self._pairs.append((look.pairs, (small[0], small[1])))
            if time.monotonic() - self._asked_s < CLIENT_S:
                self._looks.append(_Shown(look, self._board))

    def close(self) -> None:
        """Stop serving and give the port back; whoever looks is told the last word first."""
        until = time.monotonic() + LAST_WORD_S
        while self._last_word_waits() and time.monotonic() < until:
            time.sleep(0.02)
        self._server.shutdown()
        self._server.server_close()

    def _last_word_waits(self) -> bool:
        with self._lock:
            looking = time.monotonic() - self._asked_s < LAST_WORD_S
            return looking and self._newest is not None and self._newest.frame.number != self._told

    def state(self) -> bytes:
        """What the page draws, as JSON."""
        with self._lock:
            self._asked_s = time.monotonic()
            if self._newest is None:
                return json.dumps({"number": 0, "status": "waiting for the first pictures"}).encode()
            if not self._looks or self._looks[-1].number != self._newest.frame.number:
                self._looks.append(_Shown(self._newest, self._board))
            self._told = self._looks[-1].number
            return json.dumps({**self._looks[-1].state, "recent": [number for number, _ in self._pairs]}).encode()

    def picture(self, side: int, number: int | None) -> bytes | None:
        """JPEG of the moment of this number, or of the last one where that is gone; None before the first."""
        with self._lock:
            if not self._looks:
                return None
            shown = next((shown for shown in self._looks if shown.number == number), self._looks[-1])
            return shown.jpeg(side)

    def thumbnail(self, number: int, side: int) -> bytes | None:
        """Small JPEG of a pair that was taken; None for all but the last eight."""
        with self._lock:
            return next((small[side] for own, small in self._pairs if own == number), None)


class _Shown:
    """What the page draws of a look; without the pictures in full size, of which eight would be many."""

    def __init__(self, look: Look, board: Board) -> None:
        height, width = look.frame.left.shape[:2]
        self.number = look.frame.number
        self._small = [_for_screen(picture, SHOWN_SIDE) for picture in (look.frame.left, look.frame.right)]
        self._jpegs: dict[int, bytes] = {}
        self.state: dict[str, Any] = {
            "number": look.frame.number,
            "size": [width, height],
            "board": str(board),
            "columns": board.corners[0],
            "status": look.status,
            "taken": look.taken,
            "pairs": look.pairs,
            "progress": round(look.progress, 4),
            "done": look.done,
            "cameras": [
                {
                    "corners": _corners(view, (width, height)),
                    "ids": [] if view is None else view.ids.tolist(),
                    "cells": cells.tolist(),
                    "missing": missing,
                    "wanted": [AREAS[name] for name in wanted],
                }
                for view, cells, missing, wanted in zip(look.views, look.cells, look.missing, look.wanted, strict=True)
            ],
        }

    def jpeg(self, side: int) -> bytes:
        """The picture, encoded when it is first asked for."""
        if side not in self._jpegs:
            self._jpegs[side] = _jpeg(self._small[side])
        return self._jpegs[side]


class _Server(ThreadingHTTPServer):
    """A thread a connection, up to a limit; what comes beyond it is hung up on."""

    daemon_threads = True
    allow_reuse_address = True
    request_queue_size = 16
    page: LivePage

    def __init__(self, address: tuple[str, int]) -> None:
        self.address_family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
        self._free = threading.BoundedSemaphore(MOST_CONNECTIONS)
        super().__init__(address, _Handler)

    def server_bind(self) -> None:
        """Bind without asking the network for this computer's name, which may take long."""
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = str(self.server_address[0]), int(self.server_address[1])

    def process_request(self, request: Any, client_address: Any) -> None:
        if not self._free.acquire(blocking=False):
            self.shutdown_request(request)
            return
        try:
            super().process_request(request, client_address)
        except BaseException:
            self._free.release()
            raise

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        # Clients hang up in the middle of a picture all the time.
        logger.debug("page: a connection from %s failed", client_address, exc_info=True)


class _Handler(BaseHTTPRequestHandler):
    """Answers GET for a handful of fixed paths; nothing is read from the disk by a client's word."""

    protocol_version = "HTTP/1.1"
    timeout = IDLE_S
    server: _Server

    def do_GET(self) -> None:
        """Send the page, its state or a picture."""
        path, _, query = self.path.partition("?")
        if not self._addressed_here():
            self.send_error(HTTPStatus.FORBIDDEN, "this page is open to this computer alone")
            return
        page = self.server.page
        body: bytes | None
        kind = "image/jpeg"
        if path == "/":
            body, kind = _page(), "text/html; charset=utf-8"
        elif path == "/state.json":
            body, kind = page.state(), "application/json"
        elif path in PICTURES:
            body = page.picture(PICTURES[path], _whole(query.removeprefix("n=")))
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
        return None if side is None or wanted is None else self.server.page.thumbnail(wanted, side)

    def _addressed_here(self) -> bool:
        """Whether the browser was told to come here by name: a foreign page may point a name of its own at us."""
        if self.server.page.host not in LOCAL_ADDRESSES:
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


def _listen(host: str, port: int | None) -> _Server:
    for wanted in (USUAL_PORT, 0) if port is None else (port,):
        try:
            return _Server((host, wanted))
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


def _corners(view: BoardView | None, size: tuple[int, int]) -> list[list[float]]:
    """As shares of width and height."""
    if view is None:
        return []
    return [[round((x + 0.5) / size[0], 5), round((y + 0.5) / size[1], 5)] for x, y in view.corners.tolist()]


def _for_screen(picture: Any, side: int) -> Bytes:
    """The picture with at most so many px on its longer side, 8 bits, in OpenCV's order of colours."""
    if picture.dtype != "uint8":
        picture = grey(picture)
    small = shrink(picture, side)
    return small if small.ndim == 2 else cv2.cvtColor(small, cv2.COLOR_RGB2BGR)


def _jpeg(picture: Bytes) -> bytes:
    _, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return bytes(data)
