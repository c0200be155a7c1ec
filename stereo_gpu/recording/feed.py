"""Pairs read in the background, so that whoever looks at them or writes them never keeps a camera waiting."""

from __future__ import annotations

import threading
from collections import deque

from stereo_gpu.recording.frames import StereoFrame
from stereo_gpu.recording.source_thread import Stopped
from stereo_gpu.recording.stereo_reader import StereoReader

ROOM = 2  # pairs that are ready and not yet taken: more only make what is seen older


class Feed:
    """Pairs of a reader, one after the other.

    Files wait for whoever takes the pairs. A camera does not: what comes while there is no room is passed over,
    not decoded, and counted. A camera that is not read would fill its driver's buffer and give old pictures later,
    with wrong times.

    Args:
        reader: is read to its end, until it fails, or until `stop` is set; then it is closed.
        stop: ends it.

    Attributes:
        passed_over: pairs for which there was no room.
    """

    def __init__(self, reader: StereoReader, *, stop: threading.Event) -> None:
        self.reader = reader
        self.passed_over = 0
        self._stop = stop
        self._ready: deque[StereoFrame] = deque()
        self._changed = threading.Condition()
        self._error: BaseException | None = None
        self._over = False
        self._thread = threading.Thread(target=self._run, name="stereo-gpu feed", daemon=True)
        self._thread.start()

    def wait(self, limit_s: float) -> StereoFrame | None:
        """The next pair; None if none came within `limit_s`, or none will.

        Raises:
            Whatever stopped the reader, once all pairs before it were taken.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._ready or self._over, limit_s)
            if self._ready:
                self._changed.notify_all()
                return self._ready.popleft()
            if self._error is not None:
                raise self._error
            return None

    @property
    def over(self) -> bool:
        """Whether no further pair will come, and no error either: `wait` has yet to raise it."""
        return self._over and not self._ready and self._error is None

    def close(self) -> None:
        """End it, and wait until the sources are closed."""
        self._stop.set()
        with self._changed:
            self._changed.notify_all()
        self._thread.join()

    def _run(self) -> None:
        try:
            self._read()
        except Stopped:
            pass
        except BaseException as error:
            self._error = error
        finally:
            self.reader.close()
            with self._changed:
                self._over = True
                self._changed.notify_all()

    def _read(self) -> None:
        settled_s: float | None = None
        while not self._stop.is_set() and self.reader.step():
            if settled_s is None:
                settled_s = self.reader.time_s + self.reader.warm_up_s
            if self.reader.time_s < settled_s:
                continue
            if not self._room():
                self.passed_over += 1
                continue
            frame = self.reader.decode()
            if frame is not None:
                with self._changed:
                    self._ready.append(frame)
                    self._changed.notify_all()

    def _room(self) -> bool:
        """Whether there is room for a pair; from files, wait for it."""
        with self._changed:
            if not self.reader.live:
                self._changed.wait_for(lambda: len(self._ready) < ROOM or self._stop.is_set())
            return len(self._ready) < ROOM
