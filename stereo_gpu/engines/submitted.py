"""A job from when it is submitted until its answer is there."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from stereo_gpu.engines.executor import Answer, Limits, Tell
from stereo_gpu.errors import CancelledError, StereoError

logger = logging.getLogger(__name__)


class Submitted:
    """Fulfils `executor.Running`; it has one answer, whoever comes first with it.

    Args:
        job, limits: as submitted.
        began, tell: of the caller; if they fail, that is logged and nothing else.

    Attributes:
        answer: as `executor.Running` says.
        begun: whether a warm worker has it, or had it.
    """

    def __init__(
        self, job: tuple[Any, ...], limits: Limits, began: Callable[[int], None] | None, tell: Tell | None
    ) -> None:
        self.job, self.limits = job, limits
        self.answer: Future[Answer] = Future()
        self.begun = False
        self.answer.set_running_or_notify_cancel()  # it is stopped by `cancel` here, never by the future's own
        self._began, self._tell = began, tell
        self._stop: Callable[[], None] | None = None
        self._cancelled = self._ended = False
        self._changing = threading.Lock()

    def cancel(self) -> None:
        """Stop it, whether it has begun or not."""
        with self._changing:
            self._cancelled = True
            if self._stop is not None:
                self._stop()
                return
        self.fail(cancelled())

    def give(self, stop: Callable[[], None]) -> None:
        """Give it to a worker, which `stop` tells that it is wanted no more."""
        with self._changing:
            self._stop = stop

    def begin(self, worker: int) -> None:
        """Say that a warm worker has it.

        Raises:
            CancelledError: somebody cancelled it before the worker could be told so.
        """
        if self._cancelled:
            raise cancelled()
        self.begun = True
        if self._began is not None:
            try:
                self._began(worker)
            except Exception:
                logger.exception("the begin of a job could not be told")

    def tell(self, stage: str) -> None:
        """Say that a stage begins."""
        if self._tell is not None:
            try:
                self._tell(stage)
            except Exception:
                logger.exception("a stage (%s) could not be told", stage)

    def end(self, answer: Answer) -> None:
        """Answer it, unless it has been."""
        with self._changing:
            first, self._ended, self._stop = not self._ended, True, None
        if first:
            self.answer.set_result(answer)

    def fail(self, error: StereoError) -> None:
        """Answer it by an error that no worker had a part in."""
        self.end(Answer(result=None, error=error, seconds=0.0))


def cancelled() -> CancelledError:
    """What is said of a job that somebody cancelled."""
    return CancelledError("cancelled: it was wanted no more")
