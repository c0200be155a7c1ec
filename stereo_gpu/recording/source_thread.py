"""A source in a thread of its own, so that a call that hangs hangs nobody, and both cameras work at once."""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import NamedTuple, TypeVar

from stereo_gpu.errors import CameraError, InputError
from stereo_gpu.recording.sources import Opener, Source
from stereo_gpu.types import Picture

FIRST_LIMIT_S = 15.0  # for opening and for the first picture: cameras wake slowly
RETRY_S = 0.5  # between attempts to open a source again
MOST_OLD = 100  # pictures that any driver or socket keeps
LOOK_S = 0.1  # how often a wait looks whether all is to stop

Answer = TypeVar("Answer")
logger = logging.getLogger(__name__)


class Stopped(Exception):
    """The recording is to end, whatever is being waited for."""


class Grab(NamedTuple):
    """What a grab gave.

    Args:
        time_s: of the picture, seconds on the source's clock; None at the source's end.
        waited_s: how long the grab took: next to nothing if the picture had been waiting.
        passed_over: how many pictures before it were waiting, if it was to drain them.
        anew: whether the source had failed and was opened again.
    """

    time_s: float | None
    waited_s: float
    passed_over: int = 0
    anew: bool = False


class SourceThread:
    """One source, used from one thread; every question to it has a time limit.

    Args:
        opener: opens the source, and opens it anew after it has failed.
        stall_s: a source that is silent for so long has failed.
        patience_s: a live source that has failed may come back for so long.
        stop: set it, and every wait ends with `Stopped`.

    Raises:
        InputError: the source cannot be opened.
        TimeoutError: it does not open in time.
        Stopped: the recording ends.
    """

    def __init__(self, opener: Opener, *, stall_s: float, patience_s: float, stop: threading.Event) -> None:
        self._opener = opener
        self._stall_s = stall_s
        self._patience_s = patience_s
        self._stop = stop
        self._worker = _Worker()
        try:
            self.source: Source = self._wait(self._worker.open(opener), FIRST_LIMIT_S)
        except BaseException:
            self._worker.leave()  # it closes the source if that opens after all
            raise
        self.name, self.live = self.source.name, self.source.live
        self._given = False  # whether it has ever given a picture
        self._grab: Future[Grab] | None = None

    def start_grab(self) -> None:
        """Have the next picture grabbed; do not wait for it."""
        self._grab = self._worker.ask(self._timed_grab)

    def start_drain(self, wait_s: float) -> None:
        """As `start_grab`, but pass over the pictures that are waiting: grab until a grab takes `wait_s` or longer."""

        def drain() -> Grab:
            for passed_over in range(MOST_OLD):
                grab = self._timed_grab()._replace(passed_over=passed_over)
                if grab.time_s is None or grab.waited_s >= wait_s:
                    break
            return grab

        self._grab = self._worker.ask(drain)

    def finish_grab(self) -> Grab:
        """What the grab gave that was started.

        Raises:
            InputError: it has never given a picture.
            CameraError: it has failed and does not come back.
            Stopped: the recording ends.
        """
        assert self._grab is not None
        limit_s = self._stall_s if self._given and self.live else FIRST_LIMIT_S
        try:
            grab = self._wait(self._grab, limit_s)
            trouble = "gives no more pictures"
        except TimeoutError:
            grab, trouble = Grab(None, limit_s), f"has given no picture for {limit_s:g} s"
        if grab.time_s is not None:
            self._given = True
            return grab
        if not self._given:
            raise InputError(f"{self.name} opened but gives no picture: is it in use elsewhere?")
        if not self.live and not self._grab.done():
            raise CameraError(f"{self.name} {trouble}: copy it to this computer's own disk")
        if not self.live or self.source.ended:
            return grab
        return Grab(self._come_back(trouble), 0.0, anew=True)

    def retrieve(self) -> Future[Picture]:
        """Have decoded what was grabbed last; `result` waits for it."""
        return self._worker.ask(self.source.retrieve)

    def settings(self) -> dict[str, float]:
        """What the source runs with.

        Raises:
            CameraError: it hangs.
            Stopped: the recording ends.
        """
        return self.result(self._worker.ask(lambda: self.source.settings))

    def result(self, answer: Future[Answer]) -> Answer:
        """Wait for what was asked.

        Raises:
            CameraError: it takes longer than any decoding does.
            Stopped: the recording ends.
        """
        try:
            return self._wait(answer, FIRST_LIMIT_S)
        except TimeoutError:
            raise CameraError(f"{self.name} hangs: unplug it and plug it in again") from None

    def close(self) -> None:
        """Let the source go, and wait for that a little."""
        self._worker.leave(wait_s=1.0)

    def _timed_grab(self) -> Grab:
        since = time.monotonic()
        time_s = self.source.grab()
        return Grab(time_s, time.monotonic() - since)

    def _come_back(self, trouble: str) -> float:
        """Open the source anew, again and again; the time of its first picture."""
        logger.warning("%s %s: trying to open it again for %g s", self.name, trouble, self._patience_s)
        since = time.monotonic()
        # A thread that hangs in a driver cannot be ended: it is left behind, and closes its source when it wakes.
        self._worker.leave()
        while (passed := time.monotonic() - since) < self._patience_s:
            self._worker = _Worker()
            try:
                limit = max(LOOK_S, min(FIRST_LIMIT_S, self._patience_s - passed))
                self.source = self._wait(self._worker.open(self._opener), limit)
                time_s = self._wait(self._worker.ask(self.source.grab), max(self._stall_s, LOOK_S))
            except (InputError, TimeoutError):
                time_s = None
            if time_s is not None:
                logger.warning("%s is back after %.1f s", self.name, time.monotonic() - since)
                return time_s
            self._worker.leave()
            if self._stop.wait(RETRY_S):
                raise Stopped
        raise CameraError(
            f"{self.name} {trouble} and did not come back within {self._patience_s:g} s: check its cable and power"
        )

    def _wait(self, answer: Future[Answer], limit_s: float) -> Answer:
        until = time.monotonic() + limit_s
        while True:
            if self._stop.is_set():
                raise Stopped
            try:
                return answer.result(max(0.0, min(LOOK_S, until - time.monotonic())))
            except TimeoutError:
                if answer.done():  # it is the source's own error, if it is one
                    return answer.result()
                if time.monotonic() >= until:
                    raise


class _Worker:
    """A thread that opens a source, answers questions one after the other, and closes it."""

    def __init__(self) -> None:
        self._questions: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._source: Source | None = None
        # A daemon, since one that hangs in a driver must not keep the program from ending.
        self._thread = threading.Thread(target=self._run, name="stereo-gpu source", daemon=True)
        self._thread.start()

    def open(self, opener: Opener) -> Future[Source]:
        def work() -> Source:
            self._source = opener()
            return self._source

        return self.ask(work)

    def ask(self, question: Callable[[], Answer]) -> Future[Answer]:
        answer: Future[Answer] = Future()

        def work() -> None:
            try:
                answer.set_result(question())
            except BaseException as error:
                answer.set_exception(error)

        self._questions.put(work)
        return answer

    def leave(self, wait_s: float = 0.0) -> None:
        self._questions.put(None)
        self._thread.join(wait_s)

    def _run(self) -> None:
        while (question := self._questions.get()) is not None:
            question()
        if self._source is not None:
            self._source.close()
