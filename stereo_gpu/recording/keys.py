"""Presses of keys: single ones on a terminal, lines elsewhere."""

from __future__ import annotations

import os
import select
import sys
import threading
from types import TracebackType

from stereo_gpu.errors import InputError

PRESSES = {b"\n", b"\r", b" "}
ENOUGH = {b"q", b"Q", b"\x1b", b"\x04"}  # also escape, and the end of input as a terminal sends it
LOOK_S = 0.1  # how often the thread looks whether it is to end


class Keys:
    """Counts presses of Enter or space on standard input, in the background.

    A terminal gives each key at once while this is entered, and is as it was afterwards; Ctrl-C and Ctrl-Z work as
    always. From a pipe or a file, every line is a press.

    Attributes:
        on_terminal: whether a person presses them.

    Raises:
        InputError: there is no standard input.
    """

    def __init__(self) -> None:
        try:
            self._input = sys.stdin.fileno()
        except (AttributeError, ValueError, OSError) as error:  # none at all, closed, or not of the system
            raise InputError("there is no standard input to read keys from: run this in a terminal") from error
        self.on_terminal = os.isatty(self._input)
        self._presses = 0
        self._ended = False
        self._lock = threading.Lock()
        self._leaving = threading.Event()
        self._thread = threading.Thread(target=self._read, name="stereo-gpu keys", daemon=True)
        self._before: list[object] | None = None

    def __enter__(self) -> Keys:
        if self.on_terminal:
            import termios
            import tty

            self._before = termios.tcgetattr(self._input)
            tty.setcbreak(self._input)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._leaving.set()
        if self._before is not None:
            import termios

            termios.tcsetattr(self._input, termios.TCSADRAIN, self._before)  # type: ignore[arg-type]
        self._thread.join(5 * LOOK_S)

    def take(self) -> bool:
        """Whether a press was waiting; it is used up."""
        with self._lock:
            pressed = self._presses > 0
            self._presses -= pressed
            return pressed

    @property
    def ended(self) -> bool:
        """Whether no press is left and none will come: input ended, or q was pressed."""
        with self._lock:
            return self._ended and self._presses == 0

    def _read(self) -> None:
        while not self._leaving.is_set():
            try:
                ready, _, _ = select.select([self._input], [], [], LOOK_S)
                if not ready:
                    continue
                data = os.read(self._input, 4096)
            except (OSError, ValueError):  # the terminal is gone, or the input was closed
                data = b""
            with self._lock:
                if not data:
                    self._ended = True
                    return
                if not self.on_terminal:
                    self._presses += data.count(b"\n")
                    continue
                for key in (data[at : at + 1] for at in range(len(data))):
                    if key in ENOUGH:
                        self._ended = True
                        self._presses = 0
                        return
                    # Two presses before the first pair is taken are one: a person sees no use in twins.
                    self._presses |= key in PRESSES
