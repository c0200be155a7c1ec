"""A few warm child processes for xatlas, which can neither be cancelled nor trusted to end.

A cold child takes 0.15 s to import Python, numpy and xatlas, so those that need not be killed wait for the next
question. They are started at first use, one for each core that is this process' share, or as many as
STEREO_GPU_UNWRAP_PROCESSES says. They end when their stdin closes, and so with their parent, however that ends.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import queue
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from stereo_gpu.backends.share import usable_cores
from stereo_gpu.errors import InputError
from stereo_gpu.unwrap_worker import Arrays, read_frame, write_frame

PROCESSES = "STEREO_GPU_UNWRAP_PROCESSES"
_WORKER = Path(__file__).with_name("unwrap_worker.py")


@dataclass(frozen=True)
class Question:
    """What a child is asked: see unwrap_worker.py for the verbs."""

    verb: str
    arrays: Arrays


class NoAnswerError(Exception):
    """A child gave no answer; the message says why."""


class LateError(NoAnswerError):
    """The time for all questions is over."""


class _NoStartError(NoAnswerError):
    """No child can be started, so none need be tried again."""


class _Child:
    """One process. It serves one thread at a time."""

    def __init__(self) -> None:
        self._complaints = tempfile.TemporaryFile()  # noqa: SIM115  # lives as long as the child
        # As a script, not with -m, which would import the whole package first; -P keeps our types.py from passing
        # for Python's. A process of its own, not multiprocessing, since that runs the caller's main module again.
        command = [sys.executable, "-P", str(_WORKER)]
        try:
            self.process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._complaints,
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},  # it needs none, and each takes time to start
            )
        except OSError as error:
            self._complaints.close()
            raise _NoStartError(f"the process for xatlas cannot be started: {error.strerror or error}") from None
        self._ready = False

    @property
    def alive(self) -> bool:
        return self.process.poll() is None

    def ask(self, question: Question, seconds: float) -> Arrays:
        """Put a question and wait for the answer; a child that takes longer than `seconds` is killed.

        Raises:
            NoAnswerError: it was, or it ended by itself, or it has an error to tell.
        """
        late = threading.Event()

        def kill() -> None:
            late.set()
            self.process.kill()

        timer = threading.Timer(max(seconds, 0), kill)
        timer.start()
        try:
            answer = self._exchange(question, seconds)
        finally:
            timer.cancel()
            timer.join()  # or it might kill the child during the next question
        if late.is_set():
            raise NoAnswerError(f"xatlas took more than {seconds:.3g} s")
        if answer is None:
            failed = NoAnswerError if self._ready else _NoStartError
            raise failed(f"xatlas ended with status {self.process.wait()}: {self._last_words()}")
        header, arrays = answer
        if header["error"] is not None:
            raise NoAnswerError(f"xatlas failed: {header['error']}")
        return arrays

    def _exchange(self, question: Question, seconds: float) -> tuple[dict[str, str | None], Arrays] | None:
        assert self.process.stdin and self.process.stdout
        try:
            if not self._ready:
                self._ready = read_frame(self.process.stdout) is not None
            if self._ready:
                write_frame(self.process.stdin, {"verb": question.verb, "seconds": seconds}, question.arrays)
                answer = read_frame(self.process.stdout)
                if answer is not None:
                    return answer
        except (OSError, ValueError):  # no one is at the other end, or its words make no sense
            self.process.kill()
        self.process.wait()  # still under the timer: an end of its stdout need not be its own
        return None

    def end(self) -> None:
        """Kill it, leave no zombie, and close what belongs to it."""
        self.process.kill()
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout, self._complaints):
            if stream is not None:
                with contextlib.suppress(OSError):  # what was not sent is written as the file closes
                    stream.close()

    def leave_to_parent(self) -> None:
        """In a fork of the process that it belongs to: hold none of its pipes open, and do not wait for it."""
        for stream in (self.process.stdin, self.process.stdout):
            if stream is not None:
                stream.raw.close()  # type: ignore[attr-defined]  # unlike the stream's own, it sends nothing
        self.process.returncode = 0

    def _last_words(self) -> str:
        self._complaints.seek(0)
        said = self._complaints.read().decode(errors="replace").strip().splitlines()
        return said[-1] if said else "it said nothing"


class WorkerPool:
    """Children that answer questions in parallel, for any number of threads.

    Args:
        processes: how many children there are at most.
    """

    def __init__(self, processes: int) -> None:
        self._processes = processes
        # A place holds a child that waits, or None where one can be started. The last one used is the first taken.
        self._places: queue.LifoQueue[_Child | None] = queue.LifoQueue()
        for _ in range(processes):
            self._places.put(None)
        self.children: set[_Child] = set()

    def warm(self, children: int) -> None:
        """Start so many of the children, if none are there yet, without waiting for them."""
        places = []
        with contextlib.suppress(queue.Empty):
            while True:
                places.append(self._places.get_nowait())
        try:
            for index in range(min(children, len(places))):
                places[index] = places[index] or self._started()
        except NoAnswerError:
            pass  # who asks will be told
        finally:
            for place in sorted(places, key=bool):
                self._places.put(place)

    def _started(self) -> _Child:
        child = _Child()
        self.children.add(child)
        return child

    def ask(
        self, questions: Sequence[Question], *, time_limit_s: float, question_limit_s: float | None = None
    ) -> list[Arrays | NoAnswerError]:
        """Put questions to the children.

        Args:
            questions: what to ask; the first is asked first.
            time_limit_s: for all of them together, waiting for a free child included.
            question_limit_s: for each of them, so that one that hangs leaves time for the rest.

        Returns:
            For each question its answer, or why there is none.
        """
        deadline = time.monotonic() + time_limit_s
        answers: list[Arrays | NoAnswerError | None] = [None] * len(questions)
        otherwise: NoAnswerError = LateError(f"xatlas did not finish in {time_limit_s:.3g} s")
        todo = iter(enumerate(questions))
        lock = threading.Lock()
        stopped = threading.Event()
        mine: set[_Child] = set()

        def serve() -> None:
            nonlocal otherwise
            while not stopped.is_set():
                with lock:
                    index, question = next(todo, (-1, None))
                if question is None or time.monotonic() >= deadline:
                    return
                try:
                    with self._taken(deadline - time.monotonic(), mine) as child:
                        left = deadline - time.monotonic()
                        answers[index] = child.ask(question, min(left, question_limit_s or left))
                except queue.Empty:
                    return
                except _NoStartError as error:
                    otherwise = error
                    return
                except NoAnswerError as error:
                    if time.monotonic() < deadline:
                        answers[index] = error

        threads = [threading.Thread(target=serve, daemon=True) for _ in range(min(self._processes, len(questions)))]
        try:
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()  # each question has its limit
        except BaseException:  # Ctrl-C
            stopped.set()
            for child in list(mine):
                child.process.kill()
            raise
        return [otherwise if answer is None else answer for answer in answers]

    @contextlib.contextmanager
    def _taken(self, seconds: float, holders: set[_Child]) -> Iterator[_Child]:
        """A child of one's own; queue.Empty if none gets free in time."""
        child = self._places.get(timeout=max(seconds, 0))
        try:
            if child is None or not child.alive:
                self._bury(child)
                child = None
                child = self._started()
            holders.add(child)
            yield child
        finally:
            if child is not None:
                holders.discard(child)
                if not child.alive:
                    self._bury(child)
                    child = None
            self._places.put(child)

    def _bury(self, child: _Child | None) -> None:
        if child is not None:
            self.children.discard(child)
            child.end()

    def close(self) -> None:
        """End all children."""
        for child in list(self.children):
            child.end()


_pool: WorkerPool | None = None
_pool_lock = threading.Lock()


def shared_pool() -> WorkerPool:
    """The children of this process.

    Raises:
        InputError: STEREO_GPU_UNWRAP_PROCESSES is no whole number above 0.
    """
    global _pool
    with _pool_lock:
        if _pool is None:
            _pool = WorkerPool(_how_many())
            atexit.register(_pool.close)
        return _pool


def _how_many() -> int:
    given = os.environ.get(PROCESSES)
    if given is None:
        return usable_cores()
    if not (given.isdecimal() and int(given) > 0):
        raise InputError(f"{PROCESSES} is {given!r}: set it to a whole number above 0, or not at all")
    return int(given)


def _forget_after_fork() -> None:
    """The children answer the process that started them; its fork has to start its own."""
    global _pool, _pool_lock
    if _pool is not None:
        for child in list(_pool.children):
            child.leave_to_parent()
        atexit.unregister(_pool.close)
    _pool, _pool_lock = None, threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_after_fork)
