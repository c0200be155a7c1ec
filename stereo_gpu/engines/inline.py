"""Jobs in a thread of this process, one after another: for tests, and where no process may be started."""

from __future__ import annotations

import os
import platform
import threading
import time
from collections.abc import Callable
from typing import Any

from stereo_gpu.engines.call import call, in_one_line
from stereo_gpu.engines.crew import Crew
from stereo_gpu.engines.executor import Answer, Limits, Tell, Work, WorkerState
from stereo_gpu.engines.memory import resident_memory
from stereo_gpu.engines.submitted import cancelled
from stereo_gpu.engines.watch import over_a_limit
from stereo_gpu.errors import CancelledError, StereoError, WorkerError


class InlineExecutor(Crew):
    """Fulfils `executor.Executor` by one thread of this process, first come, first served.

    Nothing here can be stopped from outside. A job that is cancelled or goes over a limit ends where its task tells
    the next stage, so that one which does not tell ends by itself alone; its memory is that of this whole process. One
    that crashes takes this process with it. When the executor is closed, a job that does not end within the grace is
    answered as cancelled, and its thread is left to run out.

    Args:
        work: what is done with every job.
    """

    def __init__(self, work: Work) -> None:
        super().__init__("inline", [InlineWorker(work)])


class InlineWorker:
    """The one worker; see `crew.Worker`."""

    def __init__(self, work: Work) -> None:
        self._work = work
        self._arguments = {**work.shared, **(work.by_worker[0] if work.by_worker else {})}
        self._ready = self._busy = self._cancelled = self._stopped = False
        self._changing = threading.Condition()

    def warm(self) -> None:
        """Run `prepare`, once.

        Raises:
            WorkerError: it failed.
        """
        if not self._ready and self._work.prepare is not None:
            try:
                self._work.prepare(**self._arguments)
            except BaseException as error:  # `sys.exit` too, which would end the one thread that does jobs
                raise WorkerError(f"this process cannot get ready ({in_one_line(error)}): mend that first") from error
        self._ready = True

    def do(self, job: tuple[Any, ...], limits: Limits, tell: Tell | None, begin: Callable[[], None] | None) -> Answer:
        """Do a job here."""
        with self._changing:
            self._busy, self._cancelled = True, False
        start = time.perf_counter()

        def heed(stage: str) -> None:
            """Where a job ends that is wanted no more."""
            if self._cancelled or self._stopped:
                raise cancelled() if self._cancelled else CancelledError("stopped before it was done")
            over = over_a_limit(limits, time.perf_counter() - start, resident_memory)
            if over is not None:
                raise over
            if tell is not None:
                tell(stage)

        try:
            if self._stopped:
                raise CancelledError("stopped before it began")
            self.warm()
            if begin is not None:
                begin()
            start = time.perf_counter()
            well, result = call(
                self._work.task, job, {**self._arguments, "tell": heed} if self._work.tells else self._arguments
            )
        except StereoError as error:
            well, result = False, error
        except BaseException as error:  # a task that wants this process to end, as `sys.exit` does
            well, result = False, WorkerError(f"its task gave up ({in_one_line(error)}): try the job by itself")
        finally:
            with self._changing:
                self._busy = False
                self._changing.notify_all()
        seconds = time.perf_counter() - start
        return Answer(result=result if well else None, error=None if well else result, seconds=seconds, worker=0)

    def cancel(self) -> None:
        """Have the job under way end at its next stage."""
        self._cancelled = True

    def state(self) -> WorkerState:
        """How it is now."""
        return WorkerState(
            number=0,
            warm=self._ready,
            busy=self._busy,
            pid=os.getpid(),
            node=platform.node(),
            memory_bytes=resident_memory(),
        )

    def stop(self) -> None:
        """Have the job under way end at its next stage, and begin no other."""
        self._stopped = True

    def end(self, grace_s: float) -> None:
        """Wait so long for the job under way."""
        self.stop()
        with self._changing:
            self._changing.wait_for(lambda: not self._busy, max(0.0, grace_s))
