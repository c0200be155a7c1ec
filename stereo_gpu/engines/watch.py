"""What ends a job before its time: a limit that it goes over, or somebody who wants it no more."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from stereo_gpu.engines.executor import Limits
from stereo_gpu.engines.submitted import cancelled
from stereo_gpu.errors import StereoError, WorkerError

LOOK_S = 0.1  # how often memory is looked at
GRACE_S = 1.0  # to leave nothing half written, after which a process is killed
MEGABYTE = 1 << 20


class Watch:
    """Stops a process if its job goes over a limit or is cancelled; a context of one job, which takes one thread.

    Args:
        limits: of the job.
        memory: tells what the process holds, bytes.
        end: ends the process: asks it to, with False, or kills it, with True.

    Attributes:
        why: what the job has to be told; None while nothing has stopped it.
    """

    def __init__(self, limits: Limits, memory: Callable[[], int], end: Callable[[bool], None]) -> None:
        self._limits, self._memory, self._end = limits, memory, end
        self._cancelled = False
        self._changed = threading.Event()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._look, name="stereo-gpu watch", daemon=True)
        self.why: StereoError | None = None

    def __enter__(self) -> Watch:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Once it has ended, nothing more is stopped: the process may have its next job."""
        self._over.set()
        self._changed.set()
        self._thread.join()

    def cancel(self) -> None:
        """Ask the process to end, and kill it if it does not."""
        self._cancelled = True
        self._changed.set()

    def _look(self) -> None:
        limits = self._limits
        late = None if limits.seconds is None else time.monotonic() + limits.seconds
        while True:
            self._changed.wait(self._pause(late))
            if self._over.is_set():
                return
            if self._cancelled:
                self.why = cancelled()
                self._end(False)
                if not self._over.wait(GRACE_S):
                    self._end(True)
                return
            self.why = self._over_a_limit(late)
            if self.why is not None:
                self._end(True)
                return

    def _pause(self, late: float | None) -> float | None:
        left = None if late is None else min(max(0.0, late - time.monotonic()), threading.TIMEOUT_MAX)
        if self._limits.memory_bytes is None:
            return left
        return LOOK_S if left is None else min(LOOK_S, left)

    def _over_a_limit(self, late: float | None) -> WorkerError | None:
        seconds, memory = self._limits.seconds, self._limits.memory_bytes
        if late is not None and time.monotonic() >= late:
            return WorkerError(f"took over {seconds:g} s and was stopped: allow more time, or use smaller pictures")
        if memory is not None and (held := self._memory()) > memory:
            return WorkerError(
                f"took {held / MEGABYTE:.0f} MB, over its limit of {memory / MEGABYTE:.0f} MB, and was stopped:"
                " allow more memory, or use smaller pictures"
            )
        return None
