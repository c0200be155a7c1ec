"""What every engine that does jobs promises; the same tests run on all of them.

- Each submitted job ends in exactly one `Answer`, whatever becomes of its worker or its node.
- A worker is warm, which is to say that `Work.prepare` has run there, before it gets its first job.
- A job that fails, dies, or goes over a limit takes no other with it.
- Nothing but the job's own arguments is sent with it: large data goes by paths, on storage that all nodes share.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any, Protocol

from stereo_gpu.errors import InputError, StereoError

ENGINES = ("inline", "local", "ray")
Tell = Callable[[str], None]


@dataclass(frozen=True, kw_only=True)
class Work:
    """What an executor does with every job.

    Args:
        task: called with (*job, **shared), and with `tell=` besides where `tells`; a function that can be imported.
        shared: arguments of all jobs, sent once to each worker.
        prepare: called once in each worker before its first job, with (**shared); can be imported, too.
        tells: whether the task takes `tell`, a function that is told the name of each stage as it begins.
        by_worker: arguments that differ between workers, such as the device: worker i gets `by_worker[i % len]` besides
            `shared`; none where all are alike.
    """

    task: Callable[..., Any]
    shared: Mapping[str, Any] = field(default_factory=dict)
    prepare: Callable[..., None] | None = None
    tells: bool = False
    by_worker: Sequence[Mapping[str, Any]] = ()


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What a job may take before its process is stopped; None for no limit.

    Args:
        seconds: from when a warm worker has it.
        memory_bytes: resident memory of the job's process and all that it started.

    Raises:
        InputError: a limit is not above 0.
    """

    seconds: float | None = None
    memory_bytes: int | None = None

    def __post_init__(self) -> None:
        for limit, unit in ((self.seconds, "s"), (self.memory_bytes, "bytes")):
            if limit is not None and not (isinstance(limit, float | int) and limit > 0):
                raise InputError(f"a limit of {limit!r:.60} {unit}: give a number above 0, or None for no limit")


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What became of a job.

    Args:
        result: what the task returned; None where it failed.
        error: why it failed; None where it did not. A `WorkerError` says nothing against the job: its process died, or
            was stopped at a limit. A `CancelledError` is what `Running.cancel` leaves.
        seconds: from when a warm worker had it until its answer was there.
        worker: which of the executor's workers had it, from 0; None where none did.
    """

    result: Any
    error: StereoError | None
    seconds: float
    worker: int | None = None


@dataclass(frozen=True, kw_only=True)
class WorkerState:
    """How one worker is.

    Args:
        number: of the worker, from 0.
        warm: whether it can begin a job at once.
        busy: whether it has one.
        pid: of its process, on its node; None where there is none now.
        node: the name of its machine.
        memory_bytes: resident, of its process and all that it started; 0 where that cannot be told.
    """

    number: int
    warm: bool
    busy: bool
    pid: int | None
    node: str
    memory_bytes: int


class Running(Protocol):
    """A job that was submitted."""

    @property
    def answer(self) -> Future[Answer]:
        """Its answer, once it is there; the future itself never fails."""
        ...

    def cancel(self) -> None:
        """Stop it, whether it has begun or not; its answer then holds a `CancelledError`, unless it was there first."""
        ...


class Executor(Protocol):
    """Does jobs of one kind of work, several at once."""

    name: str
    slots: int  # workers, each of which does one job at a time

    def start(self) -> None:
        """Start and warm all workers; returns at once. A job that is submitted earlier starts what it needs."""
        ...

    def submit(
        self,
        job: tuple[Any, ...],
        *,
        limits: Limits = Limits(),  # it is frozen
        began: Callable[[int], None] | None = None,
        tell: Tell | None = None,
    ) -> Running:
        """Take a job, which waits until a worker is free: first come, first served.

        Args:
            job: the arguments of the call.
            limits: of this job.
            began: told the number of the worker that takes it, just before it does.
            tell: told each stage as it begins. Both are called from threads of the executor, and must be quick.

        Raises:
            StereoError: it was closed.
        """
        ...

    def workers(self) -> list[WorkerState]:
        """How each worker is; quick."""
        ...

    def close(self, grace_s: float = 1.0) -> None:
        """End all workers: jobs under way get `grace_s` to leave nothing half written; open answers are cancelled."""
        ...
