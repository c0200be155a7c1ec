"""Progress of long work on standard error: a bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Sequence

CLEAR_LINE = "\r\x1b[K"  # to the start of the line, and erase it
BAR_WIDTH = 24
LINES = 10  # that a search or a film prints where no bar can be drawn


class Progress:
    """A bar that is redrawn on a terminal, plain lines elsewhere; both on standard error."""

    def __init__(self, stages: Sequence[str] = ()) -> None:
        self._stages = list(stages)
        self._drawn = sys.stderr.isatty()

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        if self._drawn:
            print(CLEAR_LINE, end="", file=sys.stderr, flush=True)

    def step(self, name: str) -> None:
        """Say that the stage of this name begins."""
        if self._drawn:
            self._draw(self._stages.index(name), len(self._stages), name)
        else:
            print(f"stereo-gpu: {name}", file=sys.stderr, flush=True)

    def searched(self, done: int, total: int) -> None:
        """Say how many of the pictures have been searched for the board."""
        self._counted(done, total, "pictures searched")

    def filmed(self, done: int, total: int) -> None:
        """Say how many pictures of a film are drawn."""
        self._counted(done, total, "pictures drawn")

    def _counted(self, done: int, total: int, what: str) -> None:
        text = f"{done} of {total} {what}"
        if self._drawn:
            self._draw(done, total, text)
        elif done == total or done * LINES // total > (done - 1) * LINES // total:
            print(f"stereo-gpu: {text}", file=sys.stderr, flush=True)

    def _draw(self, done: int, total: int, text: str) -> None:
        full = BAR_WIDTH * done // total
        bar = "#" * full + "." * (BAR_WIDTH - full)
        print(f"{CLEAR_LINE}[{bar}] {text}", end="", file=sys.stderr, flush=True)
