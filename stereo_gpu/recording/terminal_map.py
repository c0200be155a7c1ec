"""Both cameras' coverage as a map on the terminal, with the reason why no pair is taken now."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable
from typing import TextIO

from stereo_gpu.boards.pair_coverage import by_picture
from stereo_gpu.recording.board_watch import Look
from stereo_gpu.recording.words import counted
from stereo_gpu.types import Ints

REDRAW_S = 0.1
SETTLED_S = 1.0  # a reason that lasts as long is worth a line where nothing can be redrawn
BAR_WIDTH = 24
LACKS = 3  # lines about what is missing
UNICODE, ASCII = "·░▒▓█", ".:+x#"  # for cells with no corner, and with one of 1, 2, 3, and 4 or more views
GAP = "    "
HIDE, SHOW, ERASE_BELOW = "\x1b[?25l", "\x1b[?25h", "\r\x1b[J"


class TerminalMap:
    """A map that is redrawn in place on a terminal; elsewhere a line for each pair and for what lasts.

    The cursor waits at the map's first line, which is empty: whatever else is printed lands there, stays, and pushes
    the map down.

    Args:
        stream: such as sys.stderr.
        clock: seconds that never run backwards.
    """

    def __init__(self, stream: TextIO, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = stream
        self._clock = clock
        self._drawn = stream.isatty() and os.environ.get("TERM") != "dumb"
        self._signs = UNICODE if _can_show(stream, UNICODE) else ASCII
        self._at_s = float("-inf")
        self._last: Look | None = None
        self._status, self._since_s, self._told = "", 0.0, ""

    def __enter__(self) -> TerminalMap:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def show(self, look: Look) -> None:
        """Draw the look, or print it where that is worth a line."""
        now = self._clock()
        self._last = look
        if not self._drawn:
            self._tell(look, now)
        elif now - self._at_s >= REDRAW_S or look.taken or look.done:
            self._at_s = now
            lines = self._lines(look)
            # Back to the empty first line: see above.
            self._write(f"{HIDE}{ERASE_BELOW}\n" + "\n".join(lines) + f"\x1b[{len(lines)}F")

    def close(self) -> None:
        """Leave the last map standing, with the cursor below it."""
        if self._drawn and self._last is not None:
            self._write(f"{ERASE_BELOW}\n" + "\n".join(self._lines(self._last)) + f"\n{SHOW}")
        self._last = None

    def _tell(self, look: Look, now: float) -> None:
        if look.status != self._status:
            self._status, self._since_s = look.status, now
        if look.taken or (now - self._since_s >= SETTLED_S and look.status != self._told):
            self._told = look.status
            self._write(f"stereo-gpu: {counted(look.pairs, 'pair')}, {look.progress:.0%}: {look.status}\n")

    def _lines(self, look: Look) -> list[str]:
        width, height = shutil.get_terminal_size()
        full = int(BAR_WIDTH * look.progress)
        bar = f"[{'#' * full}{'.' * (BAR_WIDTH - full)}] {look.progress:4.0%}  {counted(look.pairs, 'pair')}"
        lines = [bar, look.status]
        maps = [_map(cells, self._signs) for cells in look.cells]
        wide = len(maps[0][0])
        if height > len(maps[0]) + LACKS + 5 and width > 2 * wide + len(GAP):
            titles = [f"{title:<{wide}}" for title in ("left camera", "right camera")]
            lacks = [
                f"{where.removesuffix(' picture')}: {lack}" for where, own in by_picture(look.missing) for lack in own
            ]
            if len(lacks) > LACKS:
                lacks[LACKS - 1 :] = [f"and {len(lacks) - LACKS + 1} more"]
            lines = [GAP.join(titles), *map(GAP.join, zip(*maps, strict=True)), *lines, *lacks]
        return [line[: width - 1] for line in lines]

    def _write(self, text: str) -> None:
        self._stream.write(text)
        self._stream.flush()


def _map(cells: Ints, signs: str) -> list[str]:
    """A line for each row of cells; a cell is two characters wide, which makes it about square."""
    return ["".join(2 * signs[min(count, len(signs) - 1)] for count in row) for row in cells.tolist()]


def _can_show(stream: TextIO, text: str) -> bool:
    try:
        text.encode(getattr(stream, "encoding", None) or "ascii")
    except (UnicodeEncodeError, LookupError):
        return False
    return True
