"""One worker process, supervised: warm, kept within its job's limits, and started again after it died."""

from __future__ import annotations

import logging
import os
import platform
import sys
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

from stereo_gpu.backends.share import PROCESSES, usable_cores
from stereo_gpu.engines.child import Child, tell_end
from stereo_gpu.engines.executor import Answer, Limits, Tell, Work, WorkerState
from stereo_gpu.engines.memory import MEMORY_IS_KNOWN, group_memory
from stereo_gpu.engines.watch import GRACE_S, Watch
from stereo_gpu.engines.worker import TOLD, receive, send
from stereo_gpu.errors import CancelledError, StageError, StereoError, WorkerError

START = Limits(seconds=900.0)  # Python, its modules and `prepare`, which may compile kernels for minutes
_ENDING_S = 0.01  # how often an end is looked for
# What reads how many threads to start when it is loaded: PoCL, OpenBLAS, OpenMP.
_THREADS = ("POCL_MAX_PTHREAD_COUNT", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")

logger = logging.getLogger(__name__)


class WorkerProcess:
    """One process that does jobs, started when it is first needed, and again after it died.

    `warm` and `do` are called from one thread, all else from any. The process leads a group of its own, so that all
    that it starts ends with it.

    Args:
        work: what it does with every job.
        number: of the worker, from 0.
        count: workers that share this machine; each takes its part of the cores and the memory.
        environment: variables for it besides ours, such as the devices that it may see.
    """

    def __init__(self, work: Work, number: int, count: int, environment: Mapping[str, str] | None = None) -> None:
        own = work.by_worker[number % len(work.by_worker)] if work.by_worker else {}
        threads = max(1, usable_cores() // count)
        self._setup = (work.task, work.prepare, {**work.shared, **own}, work.tells, threads)
        # What the user has set stays.
        self._environment = (
            {name: str(threads) for name in _THREADS}
            | dict(os.environ)
            | {PROCESSES: str(count)}
            | dict(environment or {})
        )
        self._number = number
        self._child: Child | None = None
        self._ready = self._busy = self._occupied = self._cancelled = self._stopped = False
        self._watch: Watch | None = None
        self._changing = threading.Lock()

    def warm(self) -> None:
        """Make sure that the process is there and has run `prepare`, which a job then need not wait for.

        Raises:
            StereoError: it cannot be started or prepared, takes 15 minutes, was stopped, or `work` cannot be sent.
        """
        with self._changing:
            self._refuse_if_stopped()
            self._occupied = True
        try:
            if not (self._ready and self._child is not None and self._child.alive):
                self._bury()
                self._start()
        finally:
            with self._changing:
                self._occupied = self._busy

    def do(
        self,
        job: tuple[Any, ...],
        limits: Limits = Limits(),  # noqa: B008  # it is frozen
        tell: Tell | None = None,
        begin: Callable[[], None] | None = None,
    ) -> Answer:
        """Do one job, by a process that is started if there is none; whatever becomes of that, there is an answer.

        Args:
            job: the arguments of the call.
            limits: counted from when the process is warm. Memory is known on Linux alone; elsewhere time is limited,
                and a warning is logged.
            tell: told each stage as it begins; must not fail.
            begin: called once the process is warm; a `StereoError` that it raises is the answer.
        """
        if limits.memory_bytes is not None and not MEMORY_IS_KNOWN:
            logger.warning("memory of a job is not limited: this system does not tell what a process holds")
        with self._changing:
            self._busy = self._occupied = True
        start = time.perf_counter()
        try:
            self.warm()
            if begin is not None:
                begin()
            start = time.perf_counter()
            well, result = self._exchange(job, limits, tell)
        except StereoError as error:
            well, result = False, error
        finally:
            with self._changing:
                self._busy = self._occupied = self._cancelled = False
        seconds = time.perf_counter() - start
        return Answer(
            result=result if well else None, error=None if well else result, seconds=seconds, worker=self._number
        )

    def cancel(self) -> None:
        """Stop the job under way, if there is one: the process is asked to end, and killed a second later."""
        with self._changing:
            if self._busy:
                self._cancelled = True
                if self._watch is not None:
                    self._watch.cancel()

    def state(self) -> WorkerState:
        """How it is now."""
        child = self._child
        pid = child.pid if child is not None and child.alive else None
        return WorkerState(
            number=self._number,
            warm=pid is not None and self._ready,
            busy=self._busy,
            pid=pid,
            node=platform.node(),
            memory_bytes=0 if pid is None else group_memory(pid),
        )

    def stop(self) -> None:
        """Ask the process to end and to leave nothing half written; no other one is started."""
        with self._changing:
            self._stopped = True
            idle, child = not self._occupied, self._child
        if idle and child is not None:
            # It ends in order: a signal might reach it while it lets go of its last job.
            child.dismiss()
        else:
            self._signal(False)

    def end(self, grace_s: float = GRACE_S) -> None:
        """Ask the process to end, wait so long for it, and kill it if it does not; no other one is started."""
        self.stop()
        late = time.monotonic() + grace_s
        while self._child is not None and self._child.alive and time.monotonic() < late:
            time.sleep(_ENDING_S)
        self._bury()

    def _start(self) -> None:
        try:
            with self._changing:
                self._refuse_if_stopped()
                child = self._child = Child(self._environment)
        except OSError as error:
            raise WorkerError(
                f"its process cannot be started ({error}): close other programs, or use fewer workers"
            ) from error
        watch = self._watched(START)
        try:
            with watch:
                for message in (sys.path, self._setup):
                    send(child.jobs, message)
                refused = receive(child.answers)
        except (EOFError, OSError) as error:
            raise self._end_of(watch, when=" before it was ready") from error
        except Exception as error:  # what cannot be pickled: half a message may lie in the pipe
            raise self._end_of(watch, StageError(f"cannot be sent to another process: {error}")) from error
        finally:
            self._unwatch()
        if refused is not None:  # be it because it was stopped amid an import, which then fails in its own way
            reason = f"its process cannot get ready ({refused}): see that the device is free, and try again"
            raise self._end_of(watch, WorkerError(reason))
        self._ready = True

    def _refuse_if_stopped(self) -> None:
        if self._stopped:
            raise CancelledError("stopped: no more processes are started")

    def _exchange(self, job: tuple[Any, ...], limits: Limits, tell: Tell | None) -> tuple[bool, Any]:
        """What the process answers to a job, or why it does not."""
        child = self._child
        assert child is not None
        watch = self._watched(limits)
        try:
            with watch:
                send(child.jobs, job)
                message = receive(child.answers)
                while message[0] == TOLD:
                    if tell is not None:
                        tell(message[1])
                    message = receive(child.answers)
        except (EOFError, OSError):
            return False, self._end_of(watch)
        except Exception as error:  # what cannot be pickled, here or there: half a message may lie in the pipe
            return False, self._end_of(watch, StageError(f"cannot be sent to another process or back: {error}"))
        finally:
            self._unwatch()
            if watch.why is not None:
                self._bury()
        well, result = message
        return well, result

    def _watched(self, limits: Limits) -> Watch:
        watch = Watch(limits, self._memory, self._signal)
        with self._changing:
            self._watch = watch
            if self._cancelled:
                watch.cancel()
        return watch

    def _unwatch(self) -> None:
        with self._changing:
            self._watch = None

    def _memory(self) -> int:
        return 0 if self._child is None else group_memory(self._child.pid)

    def _signal(self, kill: bool) -> None:
        if self._child is not None:
            self._child.signal(kill=kill)

    def _bury(self) -> int:
        self._ready = False
        return 0 if self._child is None else self._child.bury()

    def _end_of(self, watch: Watch, fault: StereoError | None = None, when: str = "") -> StereoError:
        """Bury the process, and say why: it was stopped, or else by a fault, or else as its end itself tells."""
        status = self._bury()
        if watch.why is not None:
            return watch.why
        if self._stopped:  # by `end`, which may have closed the pipes under a message
            return CancelledError("stopped before it was done")
        return fault or tell_end(status, when)
