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
import threading
import time
from collections.abc import Iterator, Sequence

from stereo_gpu.backends.share import usable_cores
from stereo_gpu.errors import InputError
from stereo_gpu.unwrapping.child import Child, LateError, NoAnswerError, NoStartError, Question
from stereo_gpu.unwrapping.worker import Arrays

PROCESSES = "STEREO_GPU_UNWRAP_PROCESSES"


class WorkerPool:
    """Children that answer questions in parallel, for any number of threads.

    Args:
        processes: how many children there are at most.
    """

    def __init__(self, processes: int) -> None:
        self._processes = processes
        # A place holds a child that waits, or None where one can be started. The last one used is the first taken.
        self._places: queue.LifoQueue[Child | None] = queue.LifoQueue()
        for _ in range(processes):
            self._places.put(None)
        self.children: set[Child] = set()

    def warm(self, children: int) -> None:
        """Start so many of the children, if none are there yet, without waiting for them."""
        places: list[Child | None] = []
        try:
            with contextlib.suppress(queue.Empty):
                while True:
                    places.append(self._places.get_nowait())
            for index in range(min(children, len(places))):
                places[index] = places[index] or self._started()
        except NoAnswerError:
            pass  # who asks will be told
        finally:
            for place in sorted(places, key=bool):
                self._places.put(place)

    def _started(self) -> Child:
        child = Child()
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
        mine: set[Child] = set()

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
                except NoStartError as error:
                    otherwise = error
                    return
                except NoAnswerError as error:
                    if time.monotonic() < deadline:
                        answers[index] = error
                except Exception as error:  # no memory, no thread: it must not be lost with this thread
                    answers[index] = NoAnswerError(f"xatlas cannot be asked: {str(error) or type(error).__name__}")

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
    def _taken(self, seconds: float, holders: set[Child]) -> Iterator[Child]:
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

    def _bury(self, child: Child | None) -> None:
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
