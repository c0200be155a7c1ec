"""Workers that take jobs from one line: first come, first served, by a warm one before one that must be started."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Protocol

from stereo_gpu.engines.call import failure
from stereo_gpu.engines.executor import Answer, Limits, Tell, WorkerState
from stereo_gpu.engines.submitted import Submitted
from stereo_gpu.engines.watch import GRACE_S
from stereo_gpu.errors import CancelledError, StereoError, WorkerError

LAST_S = 0.2  # for the thread of a worker that has ended to give the answer
AGAIN_S = 5.0  # after which a worker that could not be warmed is tried again, and one that gets warm not waited for

logger = logging.getLogger(__name__)


class Worker(Protocol):
    """One worker of a crew; see `process.WorkerProcess`, which is one. `warm` and `do` are called from one thread."""

    def warm(self) -> None:
        """Make ready for jobs; returns at once if it is."""
        ...

    def do(self, job: tuple[Any, ...], limits: Limits, tell: Tell | None, begin: Callable[[], None] | None) -> Answer:
        """Do a job; whatever becomes of the worker, there is an answer."""
        ...

    def cancel(self) -> None:
        """Stop the job under way, if there is one."""
        ...

    def state(self) -> WorkerState:
        """How it is now; quick."""
        ...

    def stop(self) -> None:
        """Ask it to end; returns at once."""
        ...

    def end(self, grace_s: float) -> None:
        """End it, at the latest when the grace is over."""
        ...


class Crew:
    """Fulfils `executor.Executor` with any kind of worker; a thread each serves it.

    A worker that cannot be warmed fails a job only where no other one can take it. Once `start` was called, workers
    that die are warmed again before the next job asks for it.

    Args:
        name: of the engine.
        workers: which they are; they cost nothing until they are warmed.
    """

    def __init__(self, name: str, workers: Sequence[Worker]) -> None:
        self.name, self.slots = name, len(workers)
        self._workers = workers
        self._threads = [
            threading.Thread(target=self._serve, args=(number,), name=f"stereo-gpu worker {number}", daemon=True)
            for number in range(self.slots)
        ]
        self._waiting: deque[Submitted] = deque()
        self._warm: set[int] = set()  # with a job or without
        self._free: set[int] = set()  # warm and without one
        self._getting_warm: dict[int, float] = {}  # since when
        self._failures = 0  # to get warm, of any, since the last one that did
        self._under_way: dict[int, Submitted] = {}
        self._again = [0.0] * self.slots  # when one that could not be warmed is tried again
        self._begun = self._kept_warm = self._closed = False
        self._changing = threading.Lock()
        # A bell each, so that a job wakes one of a thousand threads rather than all.
        self._bells = [threading.Condition(self._changing) for _ in range(self.slots)]
        self._asleep: dict[int, None] = {}  # in order: the last one that fell asleep is woken first

    def start(self) -> None:
        """Start and warm all workers; returns at once."""
        with self._changing:
            self._kept_warm = True
            self._begin()
            self._wake(list(self._asleep))

    def submit(
        self,
        job: tuple[Any, ...],
        *,
        limits: Limits = Limits(),  # noqa: B008  # it is frozen
        began: Callable[[int], None] | None = None,
        tell: Tell | None = None,
    ) -> Submitted:
        """Take a job, which waits until a worker is free.

        Raises:
            StereoError: it was closed.
        """
        submitted = Submitted(job, limits, began, tell)
        with self._changing:
            if self._closed:
                raise StereoError("the workers have been stopped: open others")
            self._waiting.append(submitted)
            self._begin()
            self._wake_for_waiting()
        return submitted

    def workers(self) -> list[WorkerState]:
        """How each worker is."""
        return [worker.state() for worker in self._workers]

    def close(self, grace_s: float = GRACE_S) -> None:
        """End all workers, and cancel what has no answer then; it may be called twice, and by a callback."""
        with self._changing:
            self._closed = True
            dropped = list(self._waiting)
            self._waiting.clear()
            self._wake(list(self._asleep))
        for submitted in dropped:
            submitted.cancel()
        end = time.monotonic() + grace_s
        for worker in self._workers:
            worker.stop()
        for worker in self._workers:
            worker.end(max(0.0, end - time.monotonic()))
        for number, thread in enumerate(self._threads):
            if thread.ident is None or thread is threading.current_thread():
                continue
            thread.join(LAST_S)
            with self._changing:
                left = self._under_way.get(number)
            if left is not None:
                left.fail(CancelledError("stopped before it was done"))

    def _begin(self) -> None:
        if not self._begun and not self._closed:
            self._begun = True
            for thread in self._threads:
                thread.start()

    def _wake_for_waiting(self) -> None:
        """Wake as many as the line needs: warm ones first."""
        if not self._waiting or not self._asleep:
            return
        asleep = list(reversed(self._asleep))
        warm = [number for number in asleep if number in self._warm]
        self._wake(warm[: len(self._waiting)])
        short = len(self._waiting) - self._coming()
        if short > 0:
            self._wake([number for number in asleep if number not in self._warm and self._may_go(number)][:short])

    def _wake(self, numbers: list[int]) -> None:
        for number in numbers:
            self._asleep.pop(number, None)
            self._bells[number].notify()

    def _sleep(self, number: int) -> bool:
        """Wait to be woken; false where nobody did for long."""
        self._asleep[number] = None
        woken = self._bells[number].wait(AGAIN_S)
        self._asleep.pop(number, None)
        return woken

    def _serve(self, number: int) -> None:
        """What the thread of a worker does until the end."""
        while True:
            submitted, woken = None, True
            with self._changing:
                goes = self._may_go(number)
                if not (goes or self._closed):
                    woken = self._sleep(number)
                if self._closed:
                    return
                if goes and number in self._warm:
                    submitted = self._take()
                elif goes:
                    self._getting_warm[number] = time.monotonic()
                if submitted is not None:
                    self._free.discard(number)
                    self._under_way[number] = submitted
            if submitted is not None:
                self._do(number, submitted)
            elif number not in self._warm and goes:
                self._get_warm(number)
            elif not woken:
                self._notice_death(number)

    def _may_go(self, number: int) -> bool:
        """Whether a worker has something to do: a job to take, or to get warm for one."""
        if number in self._warm:
            return bool(self._waiting)
        if time.monotonic() < self._again[number]:
            return bool(self._waiting) and self._hopeless()
        return self._kept_warm or len(self._waiting) > self._coming()

    def _hopeless(self) -> bool:
        """Whether none can take a job, as far as is known: so many failed as there are, be it one several times."""
        return not self._warm and self._failures >= self.slots

    def _coming(self) -> int:
        """How many workers will take a job in a moment; one for which a cluster has no room may never."""
        late = time.monotonic() - AGAIN_S
        return len(self._free) + sum(since > late for since in self._getting_warm.values())

    def _take(self) -> Submitted | None:
        """The next job, of those that nobody has cancelled meanwhile."""
        while self._waiting:
            submitted = self._waiting.popleft()
            if not submitted.answer.done():
                return submitted
        return None

    def _notice_death(self, number: int) -> None:
        if number in self._warm and not self._workers[number].state().warm:
            with self._changing:
                self._lose(number)

    def _lose(self, number: int) -> None:
        self._warm.discard(number)
        self._free.discard(number)

    def _get_warm(self, number: int) -> None:
        error: StereoError | None = None
        try:
            self._workers[number].warm()
        except StereoError as reason:
            error = reason
        except Exception as fault:
            error = failure(fault)
        with self._changing:
            del self._getting_warm[number]
            if error is None:
                self._warm.add(number)
                self._free.add(number)
                self._failures = 0
                return
            self._again[number] = time.monotonic() + AGAIN_S
            self._failures += 1
            failed = self._take() if self._hopeless() else None
            self._wake_for_waiting()
        if not isinstance(error, CancelledError):
            logger.warning("worker %d cannot be made ready: %s", number, error)
        if failed is not None:
            failed.fail(error)

    def _do(self, number: int, submitted: Submitted) -> None:
        try:
            submitted.give(self._workers[number].cancel)
            answer = self._workers[number].do(
                submitted.job, submitted.limits, submitted.tell, lambda: submitted.begin(number)
            )
        except Exception as fault:
            answer = Answer(result=None, error=failure(fault), seconds=0.0)
        answer = replace(answer, worker=number if submitted.begun else None)
        with self._changing:
            del self._under_way[number]
            if isinstance(answer.error, WorkerError | CancelledError):
                self._lose(number)
                self._wake_for_waiting()
            else:
                self._free.add(number)
        submitted.end(answer)
