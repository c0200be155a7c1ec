"""Which of the moments that pass by are taken: one every so often, or one for each press of a key.

A chooser sees every moment whose skew is within the limit, in the order of time. One that takes long costs nothing:
cameras then pass over what came meanwhile, and video files wait.
"""

from __future__ import annotations

import math
from typing import Protocol

from stereo_gpu.errors import InputError
from stereo_gpu.recording.frames import StereoFrame
from stereo_gpu.recording.keys import Keys


class Chooser(Protocol):
    """Decides which pairs are taken."""

    def choose(self, frame: StereoFrame) -> bool:
        """Whether to take this pair."""
        ...

    @property
    def done(self) -> bool:
        """Whether it has enough; nothing is asked after that."""
        ...

    @property
    def status(self) -> str:
        """One line for the terminal: what it waits for."""
        ...


class IntervalChooser:
    """Takes a pair every `interval` seconds, the first at once; every pair if `interval` is 0.

    Raises:
        InputError: `interval` is negative or no number.
    """

    def __init__(self, interval: float) -> None:
        if not 0 <= interval < math.inf:
            raise InputError(f"interval = {interval:g}: give 0 seconds or more between pairs")
        self._interval = interval
        self._due_s = -math.inf
        self._left_s = 0.0

    def choose(self, frame: StereoFrame) -> bool:
        """Whether the interval has passed."""
        # Half a millisecond, since a film's times are rounded.
        self._left_s = self._due_s - frame.time_s - 0.0005
        if self._left_s > 0:
            return False
        # From this pair on, not from when it was due: after a gap no burst makes up for it.
        self._due_s = frame.time_s + self._interval
        self._left_s = self._interval
        return True

    @property
    def done(self) -> bool:
        """Never: the count or the source's end stops it."""
        return False

    @property
    def status(self) -> str:
        """How long until the next pair."""
        return f"next pair in {max(0.0, self._left_s):.1f} s" if self._interval else "every pair is taken"


class KeyChooser:
    """Takes the pair that comes next after each press of a key."""

    def __init__(self, keys: Keys) -> None:
        self._keys = keys

    def choose(self, frame: StereoFrame) -> bool:
        """Whether a key was pressed."""
        return self._keys.take()

    @property
    def done(self) -> bool:
        """Whether no more presses will come."""
        return self._keys.ended

    @property
    def status(self) -> str:
        """What to press."""
        return "press Enter or space to take a pair, q to end"
