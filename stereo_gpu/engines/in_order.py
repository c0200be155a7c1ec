"""Any number of jobs through an executor: answers in the order of the jobs, and no more under way than are wanted."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future
from typing import Any

from stereo_gpu.engines.executor import Answer, Executor, Limits, Running
from stereo_gpu.errors import InputError, StereoError, WorkerError

WAITING_EACH = 2  # jobs begun and not yet taken by the caller, a slot: one that is done while the next is under way


def run_in_order(
    executor: Executor,
    jobs: Iterable[tuple[Any, ...]],
    *,
    limits: Limits = Limits(),  # noqa: B008  # it is frozen
    tries: int = 1,
    began: Callable[[int, int], None] | None = None,
) -> Generator[Answer]:
    """Do jobs; `jobs` is asked for no more than two a slot ahead of what the caller has taken, which bounds the memory.

    The executor is closed when the last answer was taken, or the caller stops early, by `close` or an error of its own.

    Args:
        executor: who does them; nobody else needs it any more.
        jobs: the arguments of each call.
        limits: of each job.
        tries: how often a job is done that ends in a `WorkerError`.
        began: told the index of a job, from 0, and the worker that takes it, at each try.

    Returns:
        Gives an answer a job, in the order of the jobs; that of its last try.

    Raises:
        InputError: `tries` is below 1.
    """
    if isinstance(tries, bool) or not isinstance(tries, int) or tries < 1:
        raise InputError(f"tries = {tries!r:.60}: give a whole number above 0")
    return _run(executor, jobs, limits, tries, began)


def _run(
    executor: Executor,
    jobs: Iterable[tuple[Any, ...]],
    limits: Limits,
    tries: int,
    began: Callable[[int, int], None] | None,
) -> Generator[Answer]:
    waiting: deque[_Tried] = deque()
    try:
        for index, job in enumerate(jobs):
            waiting.append(_Tried(executor, index, job, limits, tries, began))
            if len(waiting) >= WAITING_EACH * executor.slots:
                yield waiting.popleft().answer.result()
        while waiting:
            yield waiting.popleft().answer.result()
    finally:
        executor.close()


class _Tried:
    """A job that is submitted again when its worker is lost, until its tries are over."""

    def __init__(
        self,
        executor: Executor,
        index: int,
        job: tuple[Any, ...],
        limits: Limits,
        tries: int,
        began: Callable[[int, int], None] | None,
    ) -> None:
        self.answer: Future[Answer] = Future()
        self._executor, self._job, self._limits, self._left = executor, job, limits, tries
        self._began = None if began is None else lambda worker: began(index, worker)
        self._submit()

    def _submit(self) -> None:
        self._left -= 1
        running: Running = self._executor.submit(self._job, limits=self._limits, began=self._began)
        running.answer.add_done_callback(self._take)

    def _take(self, done: Future[Answer]) -> None:
        """Called in a thread of the executor."""
        answer = done.result()
        if isinstance(answer.error, WorkerError) and self._left:
            try:
                self._submit()
            except StereoError:  # it was closed meanwhile
                self.answer.set_result(answer)
        else:
            self.answer.set_result(answer)
