"""How far the jobs under way are, in memory: what the table learns a heartbeat later, or never."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from stereo_gpu.service.jobs.order import STEP, stages_of
from stereo_gpu.service.records import Kind

Listener = Callable[[], None]

log = logging.getLogger("stereo_gpu.service")


@dataclass(frozen=True, kw_only=True)
class Progress:
    """How far a job under way is.

    Args:
        stage: that has begun last; None while it waits for a worker.
        fraction: of the work, 0..1: that of the stages which have ended.
        seconds: of each stage that has ended.
        steps: of which there are pictures, in the order in which they came.
        worker: which has it; None while it waits.
    """

    stage: str | None = None
    fraction: float = 0.0
    seconds: dict[str, float] = field(default_factory=dict)
    steps: tuple[str, ...] = ()
    worker: int | None = None


class Live:
    """What is known of jobs under way, and who wants to hear of which job; may be used from any thread.

    Args:
        clock: seconds that only grow.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._jobs: dict[str, _Running] = {}
        self._listeners: dict[str, list[Listener]] = {}

    def begin(self, job: str, kind: Kind) -> None:
        """A job has been leased; it waits for a worker."""
        with self._lock:
            self._jobs[job] = _Running(stages_of(kind))
        self.changed(job)

    def took(self, job: str, worker: int) -> None:
        """A worker begins with it."""
        with self._lock:
            if job in self._jobs:
                self._jobs[job].worker = worker
        self.changed(job)

    def tell(self, job: str, word: str) -> None:
        """What the worker says: `STAGE` as one begins, `STAGE:0.35` where it is in one, `step:NAME` of a picture."""
        with self._lock:
            if job not in self._jobs:
                return
            self._jobs[job].hear(word, self._clock())
        self.changed(job)

    def end(self, job: str) -> None:
        """It is no longer under way; the table says how it ended."""
        with self._lock:
            self._jobs.pop(job, None)
        self.changed(job)

    def progress(self, job: str) -> Progress | None:
        """How far a job is; None unless it is under way."""
        with self._lock:
            running = self._jobs.get(job)
            return None if running is None else running.progress()

    def has_begun(self, job: str) -> bool:
        """Whether a worker has the job."""
        with self._lock:
            running = self._jobs.get(job)
            return running is not None and running.worker is not None

    def stages(self) -> dict[str, tuple[str | None, float]]:
        """Stage and fraction of every job under way, for the table."""
        with self._lock:
            return {job: (running.stage, running.fraction) for job, running in self._jobs.items()}

    def subscribe(self, job: str, listener: Listener) -> None:
        """Call `listener` whenever something of the job changes, from whichever thread changes it: it must be quick."""
        with self._lock:
            self._listeners.setdefault(job, []).append(listener)

    def unsubscribe(self, job: str, listener: Listener) -> None:
        """Call it no more, but for a call that is under way."""
        with self._lock:
            listeners = self._listeners.get(job, [])
            if listener in listeners:
                listeners.remove(listener)
            if not listeners:
                self._listeners.pop(job, None)

    def changed(self, job: str) -> None:
        """Tell whoever wants to hear of this job."""
        with self._lock:
            listeners = tuple(self._listeners.get(job, ()))
        _call(listeners)

    def queue_moved(self) -> None:
        """Tell whoever waits for a job that no worker has: its place in the queue has changed."""
        with self._lock:
            begun = {job for job, running in self._jobs.items() if running.worker is not None}
            listeners = [each for job, some in self._listeners.items() if job not in begun for each in some]
        _call(listeners)


def _call(listeners: Iterable[Listener]) -> None:
    for listener in listeners:
        try:
            listener()
        except Exception:  # a connection that has just closed must not end the job's thread
            log.exception("a listener failed")


class _Running:
    """One job under way; its owner holds the lock."""

    def __init__(self, stages: Sequence[str]) -> None:
        self._stages = stages
        self._began: float | None = None
        self._seconds: dict[str, float] = {}
        self._steps: list[str] = []
        self.stage: str | None = None
        self.fraction = 0.0
        self.worker: int | None = None

    def hear(self, word: str, now: float) -> None:
        if word.startswith(STEP):
            step = word.removeprefix(STEP)
            if step not in self._steps:
                self._steps.append(step)
            return
        stage, _, part = word.partition(":")
        if stage != self.stage:
            if self.stage is not None and self._began is not None:
                self._seconds[self.stage] = self._seconds.get(self.stage, 0.0) + now - self._began
            self.stage, self._began = stage, now
        if stage in self._stages:
            reached = (self._stages.index(stage) + (float(part) if part else 0.0)) / len(self._stages)
            self.fraction = max(self.fraction, reached)  # the check of the rig may come late

    def progress(self) -> Progress:
        return Progress(
            stage=self.stage,
            fraction=self.fraction,
            seconds=dict(self._seconds),
            steps=tuple(self._steps),
            worker=self.worker,
        )
