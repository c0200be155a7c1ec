"""What runs on a node of a Ray cluster: an actor that supervises one worker process.

It imports no Ray: `ray_worker.py`, at the other end, makes an actor of it. Limits, cancelling and the death of the
process are thus the same code as on one machine. Jobs and answers are pickled here and there, so that what cannot be
sent is told as everywhere else, and arrays are the caller's own.
"""

from __future__ import annotations

import pickle
import queue
import sys
import threading
from collections.abc import Iterator

from stereo_gpu.backends.share import usable_cores
from stereo_gpu.engines.call import failure
from stereo_gpu.engines.executor import Answer, Limits, Tell, WorkerState
from stereo_gpu.engines.process import WorkerProcess
from stereo_gpu.engines.submitted import cancelled
from stereo_gpu.errors import StageError, StereoError


class RayActor:
    """One worker process and what keeps it. `warm`, `do` and `stream` are called one at a time, all else at any time.

    Args:
        work: pickled.
        number: of the worker, from 0.
        cores: of its node that are its own.
        path: where the other end finds its modules.
        version: of this package at the other end.
    """

    def __init__(self, work: bytes, number: int, cores: float, path: list[str], version: str) -> None:
        from importlib.metadata import version as installed

        here = installed("stereo-gpu")
        self._refused: StereoError | None = None
        sys.path.extend(entry for entry in path if entry not in sys.path)
        self._number, self._serial = number, -1
        self._process: WorkerProcess | None = None
        self._cancelled: set[int] = set()
        self._changing = threading.Lock()
        if here != version:
            self._refused = StageError(f"its node has stereo-gpu {here}, the others {version}: install the same one")
            return
        try:
            self._process = WorkerProcess(pickle.loads(work), number, max(1, round(usable_cores() / cores)))
        except Exception as error:
            self._refused = failure(error)

    def warm(self) -> tuple[WorkerState | None, StereoError | None]:
        """Make the process ready: how it is then, or why it is not."""
        if self._process is None:
            return None, self._refused
        try:
            self._process.warm()
        except StereoError as error:
            return None, error
        return self._process.state(), None

    def do(self, serial: int, job: bytes, limits: Limits) -> bytes:
        """Do a job that has a number of its own: the pickled answer."""
        return self._do(serial, job, limits, None)

    def stream(self, serial: int, job: bytes, limits: Limits) -> Iterator[str | bytes]:
        """Do a job: each stage as it begins, then the pickled answer."""
        told: queue.SimpleQueue[str | bytes] = queue.SimpleQueue()
        worker = threading.Thread(target=lambda: told.put(self._do(serial, job, limits, told.put)))
        worker.start()
        while isinstance(item := told.get(), str):
            yield item
        worker.join()
        yield item

    def cancel(self, serial: int) -> None:
        """Stop a job, or see that it does not begin."""
        with self._changing:
            if serial >= self._serial:
                self._cancelled.add(serial)
            if serial == self._serial and self._process is not None:
                self._process.cancel()

    def state(self) -> WorkerState | None:
        """How the process is."""
        return None if self._process is None else self._process.state()

    def stop(self) -> None:
        """Ask the process to end."""
        if self._process is not None:
            self._process.stop()

    def end(self, grace_s: float) -> None:
        """End the process."""
        if self._process is not None:
            self._process.end(grace_s)

    def _do(self, serial: int, job: bytes, limits: Limits, tell: Tell | None) -> bytes:
        with self._changing:
            self._serial = serial
        try:
            answer = self._answer(serial, job, limits, tell)
            return pickle.dumps(answer, protocol=5)
        except Exception as error:  # what cannot be understood here, or sent back
            answer = Answer(result=None, error=failure(error), seconds=0.0, worker=self._number)
            return pickle.dumps(answer, protocol=5)
        finally:
            with self._changing:
                self._serial = serial + 1
                self._cancelled = {wanted for wanted in self._cancelled if wanted > serial}

    def _answer(self, serial: int, job: bytes, limits: Limits, tell: Tell | None) -> Answer:
        if self._process is None:
            return Answer(result=None, error=self._refused, seconds=0.0, worker=self._number)

        def begin() -> None:
            with self._changing:
                if serial in self._cancelled:
                    raise cancelled()

        return self._process.do(pickle.loads(job), limits, tell, begin)
