"""Jobs done in processes of their own: several at once, answers in order, and one that dies takes no other with it."""

from __future__ import annotations

import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stereo_gpu.backends.share import PROCESSES, usable_cores
from stereo_gpu.batching.worker import receive, send
from stereo_gpu.errors import InputError, StageError, StereoError

_SCRIPT = Path(__file__).with_name("worker.py")
WAITING_EACH = 2  # jobs begun and not yet taken by the caller, a worker: one that is done while the next is under way
MOST_WORKERS = 1024  # more is a slip of the finger, for which no machine has the memory
GRACE_S = 1.0  # to leave nothing half written, after which a process is killed
_PIPE_BYTES = 1 << 20  # the most that Linux gives anybody: fewer turns for a result of 10 MB
# What reads how many threads to start when it is loaded: PoCL, OpenBLAS, OpenMP.
_THREADS = ("POCL_MAX_PTHREAD_COUNT", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What became of a job.

    Args:
        result: what the task returned; None where it failed.
        error: why it failed; None where it did not.
        seconds: from when it was given to a process until its answer was there.
    """

    result: Any
    error: StereoError | None
    seconds: float


def run_jobs(
    task: Callable[..., Any],
    jobs: Iterable[tuple[Any, ...]],
    *,
    shared: dict[str, Any],
    workers: int | None = None,
    limit_s: float | None = None,
) -> Generator[Answer]:
    """Do jobs in processes of their own, one a core, each with its share of the cores and the memory.

    A process that dies, whatever ends it, fails the job that it had; the next job gets a new one. `jobs` is asked for
    no more than two a worker ahead of what the caller has taken, so that memory is bounded. When the caller stops
    early, by `close` or an error of its own, the processes get a second to clean up and are then killed.

    Args:
        task: a function that can be imported, called with (*job, **shared) in one of the processes.
        jobs: the arguments of each call.
        shared: arguments of all calls, sent once to each process.
        workers: how many processes; None for one a core.
        limit_s: seconds after which a job's process is killed and the job has failed; its start does not count. None
            for no limit.

    Returns:
        Gives an answer a job, in the order of the jobs.

    Raises:
        InputError: `workers` or `limit_s` is out of range.
    """
    cores = usable_cores()
    count = min(cores, MOST_WORKERS) if workers is None else workers
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= MOST_WORKERS:
        raise InputError(
            f"workers = {workers!r:.60}: give a number of processes, 1 to {MOST_WORKERS}, or None for one a core"
        )
    if limit_s is not None and not limit_s > 0:
        raise InputError(f"limit_s = {limit_s!r:.60}: give a number of seconds above 0, or None for no limit")
    return _run((task, shared, max(1, cores // count)), iter(jobs), count, limit_s)


def _run(
    setup: tuple[Any, dict[str, Any], int], jobs: Iterator[tuple[Any, ...]], count: int, limit_s: float | None
) -> Generator[Answer]:
    crew = [_Worker(setup, count) for _ in range(count)]
    idle: queue.SimpleQueue[_Worker] = queue.SimpleQueue()
    for worker in crew:
        idle.put(worker)

    def do(job: tuple[Any, ...]) -> Answer:
        worker = idle.get()
        try:
            return worker.do(job, limit_s)
        finally:
            idle.put(worker)

    pool = ThreadPoolExecutor(count, thread_name_prefix="stereo-gpu worker")
    waiting: deque[Future[Answer]] = deque()
    try:
        for job in jobs:
            waiting.append(pool.submit(do, job))
            if len(waiting) >= WAITING_EACH * count:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        _stop(crew)
        pool.shutdown()


class _Worker:
    """One process, started when it is first needed, and again after it died."""

    def __init__(self, setup: tuple[Any, dict[str, Any], int], count: int) -> None:
        self._setup = setup
        # What the user has set stays.
        self._environment = {name: str(setup[2]) for name in _THREADS} | dict(os.environ) | {PROCESSES: str(count)}
        self._process: subprocess.Popen[bytes] | None = None
        self._stopped = self._busy = False
        self._changing = threading.Lock()

    def do(self, job: tuple[Any, ...], limit_s: float | None) -> Answer:
        """Do one job."""
        start = time.perf_counter()
        late = threading.Event()
        with self._changing:
            self._busy = True
        try:
            jobs, answers = self._streams()
            with self._limit(limit_s, late):
                send(jobs, job)
                well, result = receive(answers)
        except (EOFError, OSError) as error:
            well, result = False, self._death(error, limit_s if late.is_set() else None)
        except Exception as error:  # what cannot be pickled, here or there: half a message may lie in the pipe
            well, result = False, StageError(f"cannot be sent to another process or back: {error}")
            self._bury()
        finally:
            self._busy = False
        seconds = time.perf_counter() - start
        return Answer(result=result if well else None, error=None if well else result, seconds=seconds)

    def _streams(self) -> tuple[Any, Any]:
        """The process's stdin and stdout; those of a new process, once it is ready, if there is none."""
        process = self._process
        if process is None or process.poll() is not None:
            self._bury()
            process = self._start()
            for message in (sys.path, self._setup):
                send(process.stdin, message)  # type: ignore[arg-type]
            receive(process.stdout)  # type: ignore[arg-type]
        return process.stdin, process.stdout

    def _start(self) -> subprocess.Popen[bytes]:
        with self._changing:
            if self._stopped:
                raise EOFError("no more processes are started")
            self._process = None
            self._process = subprocess.Popen(
                [sys.executable, "-P", str(_SCRIPT)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=self._environment,
                pipesize=_PIPE_BYTES,
                # Its own group, so that Ctrl-C reaches this process alone, and all that it starts ends with it.
                process_group=0 if hasattr(os, "killpg") else None,
            )
            return self._process

    @contextmanager
    def _limit(self, limit_s: float | None, late: threading.Event) -> Iterator[None]:
        """Kill the process if the block takes longer, and tell by `late`."""

        def stop() -> None:
            late.set()
            self.end(kill=True)

        if limit_s is None:
            yield
            return
        timer = threading.Timer(limit_s, stop)
        timer.start()
        try:
            yield
        finally:
            timer.cancel()
            timer.join()  # or it might kill the process during the next job
            if late.is_set():
                self._bury()

    def _death(self, error: Exception, limit_s: float | None) -> StageError:
        status = self._bury()
        if status is None:
            return StageError(f"its process cannot be started ({error}): close other programs, or use fewer workers")
        if limit_s is not None:
            return StageError(f"took over {limit_s:g} s and was stopped: allow more time, or use smaller pictures")
        if status == -9:
            return StageError("its process was killed, as where memory runs out: use fewer workers or smaller pictures")
        how = f"signal {signal.Signals(-status).name}" if status < 0 else f"exit status {status}"
        return StageError(f"its process ended by {how}: try the pair by itself, or another backend")

    def _bury(self) -> int | None:
        """Make sure that the process is gone, and all that it started; returns its exit status, None without one."""
        if self._process is None:
            return None
        self.end(kill=True)
        status = self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            assert stream is not None
            with suppress(OSError):  # what could not be written any more
                stream.close()
        return status

    def end(self, *, kill: bool) -> None:
        """Signal the process and all that it started."""
        # Once it has been waited for, its number may be another's.
        if self._process is None or self._process.returncode is not None:
            return
        with suppress(OSError):  # it is gone already
            if hasattr(os, "killpg"):
                os.killpg(self._process.pid, signal.SIGKILL if kill else signal.SIGTERM)
            else:
                self._process.kill()

    def stop(self) -> None:
        """Ask the process to end and to leave nothing half written; no other one is started."""
        with self._changing:
            self._stopped = True
            idle = not self._busy
        if idle and self._process is not None and self._process.stdin is not None:
            # It ends when there are no more jobs, in order: a signal might reach it while it lets go of the last one.
            with suppress(OSError):
                self._process.stdin.close()
        else:
            self.end(kill=False)

    def wait(self, seconds: float) -> None:
        """Wait for the end that was asked for, and kill the process if it does not come."""
        if self._process is None:
            return
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(seconds)
        self._bury()


def _stop(crew: list[_Worker]) -> None:
    """End all processes: all are asked, then waited for together."""
    end = time.monotonic() + GRACE_S
    for worker in crew:
        worker.stop()
    for worker in crew:
        worker.wait(max(0.0, end - time.monotonic()))
