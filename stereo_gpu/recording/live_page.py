"""A page on this computer that shows a capture as it goes: both pictures, the corners, the coverage, what is missing.

The page asks for a small JSON and two small pictures some times a second, so it works through an ssh tunnel. Pictures
are shrunk and encoded only while somebody looks.
"""

from __future__ import annotations

import getpass
import json
import os
import socket
import threading
import time
from collections import deque
from typing import Any

import cv2

from stereo_gpu.boards.board import Board, BoardView
from stereo_gpu.boards.coverage import COLUMNS, REGIONS, ROWS
from stereo_gpu.images import grey
from stereo_gpu.recording.board_watch import Look
from stereo_gpu.recording.page_server import LOCAL, LOCAL_ADDRESSES, listen
from stereo_gpu.recording.quick_find import shrink
from stereo_gpu.types import Bytes

SHOWN_SIDE, THUMBNAIL_SIDE = 800, 200  # px
QUALITY = 80  # of JPEG
LOOKS_KEPT = 8  # since a picture is asked for a little later than the JSON that names it
PAIRS_KEPT = 8
CLIENT_S = 5.0  # somebody looks if he has asked for something within so long
LAST_WORD_S = 1.0  # at the end, somebody who looks gets so long to ask once more
AREAS = {  # left, top, right and bottom of the regions, as shares of the picture
    name: [columns.start / COLUMNS, rows.start / ROWS, columns.stop / COLUMNS, rows.stop / ROWS]
    for name, rows, columns in REGIONS
}


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
        self._server = listen(host, port, self)
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
