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
        start = time.perf_counter()
        while True:
            self._changed.wait(self._pause(time.perf_counter() - start))
            if self._over.is_set():
                return
            if self._cancelled:
                self.why = cancelled()
                self._end(False)
                if not self._over.wait(GRACE_S):
                    self._end(True)
                return
            self.why = over_a_limit(self._limits, time.perf_counter() - start, self._memory)
            if self.why is not None:
                self._end(True)
                return

    def _pause(self, passed: float) -> float | None:
        """How long there is nothing to look at, s; None for ever."""
        seconds, memory = self._limits.seconds, self._limits.memory_bytes
        left = None if seconds is None else min(max(0.0, seconds - passed), threading.TIMEOUT_MAX)
        if memory is None:
            return left
        return LOOK_S if left is None else min(LOOK_S, left)


def over_a_limit(limits: Limits, passed: float, memory: Callable[[], int]) -> WorkerError | None:
    """What is said of a job that has taken `passed` seconds and holds `memory` bytes; None within its limits."""
    if limits.seconds is not None and passed >= limits.seconds:
        return WorkerError(f"took over {limits.seconds:g} s and was stopped: allow more time, or use smaller pictures")
    if limits.memory_bytes is not None and (held := memory()) > limits.memory_bytes:
        return WorkerError(
            f"took {held / MEGABYTE:.0f} MB, over its limit of {limits.memory_bytes / MEGABYTE:.0f} MB, and was"
            " stopped: allow more memory, or use smaller pictures"
        )
    return None
