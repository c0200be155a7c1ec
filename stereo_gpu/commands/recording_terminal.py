"""What the terminal shows of a recording, and how Ctrl-C ends one."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TextIO

from stereo_gpu.progress import CLEAR_LINE

if TYPE_CHECKING:
    from stereo_gpu.recording.pair_writer import Taken

REDRAW_S = 0.1
ECHO_S = 0.5  # programs that start others pass on a Ctrl-C which the terminal has sent to all of them


class Lines:
    """What the terminal shows while pairs are taken: a line for each, and one that is redrawn below.

    Args:
        count: how many are to be taken, if that is limited.
        each: whether every pair gets a line.
        status: whether what is waited for is shown.
        stop: is set when nobody can be told any more, so that what was taken is still written.
    """

    def __init__(self, count: int | None, *, each: bool, status: bool, stop: threading.Event) -> None:
        self._count = count
        self._stop = stop
        self._each = each
        self._drawn = status and sys.stderr.isatty()
        self._taken = 0
        self._drawn_s = 0.0

    def pair(self, pair: Taken) -> None:
        """Tell of a pair."""
        self._taken += 1
        if self._each:
            self._clear()
            self._print(
                f"pair {pair.number}: {pair.left.name}, {pair.right.name}, skew {pair.skew_ms:.1f} ms\n", sys.stdout
            )

    def status(self, text: str) -> None:
        """Show what is waited for, some times a second."""
        now = time.monotonic()
        if self._drawn and now - self._drawn_s >= REDRAW_S:
            self._drawn_s = now
            of = "" if self._count is None else f" of {self._count}"
            self._print(f"{CLEAR_LINE}{self._taken}{of} taken; {text}", sys.stderr)

    def close(self) -> None:
        """Leave the line empty."""
        self._clear()

    def _clear(self) -> None:
        if self._drawn:
            self._print(CLEAR_LINE, sys.stderr)

    def _print(self, text: str, stream: TextIO) -> None:
        try:
            print(text, end="", file=stream, flush=True)
        except OSError:  # the terminal is closed, or whoever read our output has had enough
            self._stop.set()


class SignalledStop(threading.Event):
    """An event that signals set, too.

    Attributes:
        signals: those that came. Its handler adds to them and takes no lock: a handler runs wherever the main thread
            is, in `set` or in another handler as well, and would wait for itself there.
    """

    def __init__(self) -> None:
        super().__init__()
        self.signals: list[int] = []

    def is_set(self) -> bool:
        """Whether a signal came or somebody called `set`."""
        return bool(self.signals) or super().is_set()


@contextmanager
def stopping_on_signals() -> Iterator[SignalledStop]:
    """An event that the first signal to end sets; a second one, later than the first one's echo, ends at once."""
    stop = SignalledStop()
    first_s = 0.0

    def handle(number: int, _: Any) -> None:
        nonlocal first_s
        now = time.monotonic()
        if not stop.signals:
            first_s = now
        stop.signals.append(number)
        if now - first_s > ECHO_S:
            raise KeyboardInterrupt

    wanted = [signal.SIGINT, signal.SIGTERM]
    # Ignored under nohup, which is there so that a recording outlives its terminal; Windows has no such signal.
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
        wanted.append(signal.SIGHUP)
    before = {number: signal.signal(number, handle) for number in wanted}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
