"""One worker on a Ray cluster, seen from here: an actor that is made anew, elsewhere if need be, when it is lost."""

from __future__ import annotations

import pickle
import sys
import threading
import time
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

from stereo_gpu.engines.call import in_one_line
from stereo_gpu.engines.executor import Answer, Limits, Tell, WorkerState
from stereo_gpu.engines.ray_actor import RayActor
from stereo_gpu.engines.submitted import cancelled
from stereo_gpu.errors import CancelledError, StageError, StereoError, WorkerError

CONTROL = "control"  # the actor's threads for all but jobs, which have one
LOOK_S = 0.2  # how often it is seen, while no node has room, whether the worker is wanted still
OLD_S = 2.0  # after which it is asked again how the worker is
MAKINGS = 3  # for one call: the first actor may be sent to a node of which nobody knows yet that it is gone
END_S = 2.0  # for an actor to answer that its process has ended, beyond the grace


class RayWorker:
    """Fulfils `crew.Worker` by an actor.

    Args:
        work: pickled `executor.Work`.
        number: of the worker, from 0.
        num_cpus, num_gpus: what it takes of its node.
    """

    def __init__(self, work: bytes, number: int, num_cpus: float, num_gpus: float) -> None:
        import ray

        self._actors = ray.remote(concurrency_groups={CONTROL: 2})(RayActor).options(
            num_cpus=num_cpus, num_gpus=num_gpus, max_restarts=0, max_task_retries=0
        )
        self._arguments = (work, number, num_cpus, list(sys.path), version("stereo-gpu"))
        self._number, self._serial = number, 0
        self._actor: Any = None
        self._warm = self._busy = self._cancelled = self._stopped = False
        self._told = WorkerState(number=number, warm=False, busy=False, pid=None, node="", memory_bytes=0)
        self._asked: Any = None
        self._asked_at = 0.0
        self._changing = threading.Lock()

    def warm(self) -> None:
        """Have an actor and its process ready; waits until a node has room for it.

        Raises:
            StereoError: it cannot be made or get ready.
        """
        import ray

        if self._warm:
            return
        for left in reversed(range(MAKINGS)):
            try:
                state, error = self._wait(self._make().warm.remote())
            except ray.exceptions.RayError as reason:
                self._drop()
                if left:
                    continue
                raise WorkerError(f"its actor cannot be made ({_why(reason)}): see `ray status`") from reason
            if error is not None:
                self._drop()  # which makes room: another worker may wait for it, on a node where all is well
                raise error
            self._told, self._warm = state, True
            return

    def do(self, job: tuple[Any, ...], limits: Limits, tell: Tell | None, begin: Callable[[], None] | None) -> Answer:
        """Do a job; if its actor or node is lost, the answer is a `WorkerError`."""
        import ray

        with self._changing:
            self._busy = True
        try:
            sent = pickle.dumps(job, protocol=5)
            self.warm()
            if begin is not None:
                begin()
            answer: Answer = pickle.loads(self._exchange(sent, limits, tell))
        except StereoError as error:
            answer = self._failed(error)
        except ray.exceptions.RayError as error:
            node = self._told.node
            self._drop()
            ended = cancelled() if self._cancelled else CancelledError("stopped before it was done")
            lost = WorkerError(f"its worker on {node} was lost ({_why(error)}): the job may go well on another")
            answer = self._failed(ended if self._cancelled or self._stopped else lost)
        except Exception as error:
            answer = self._failed(StageError(f"cannot be sent to another process or back: {error}"))
        finally:
            with self._changing:
                self._busy = self._cancelled = False  # or the next call of `warm` would be taken for cancelled
                self._serial += 1
        if isinstance(answer.error, WorkerError | CancelledError):
            self._warm = False
        return answer

    def cancel(self) -> None:
        """Stop the job under way, if there is one."""
        with self._changing:
            if self._busy:
                self._cancelled = True
                self._tell_actor("cancel", self._serial)

    def state(self) -> WorkerState:
        """How it was a moment ago; asks anew without waiting, by which a loss is noticed, too."""
        import ray

        try:
            with self._changing:
                if self._asked is not None and ray.wait([self._asked], timeout=0)[0]:
                    self._told, self._asked = ray.get(self._asked) or self._told, None
                elif self._asked is None and self._actor is not None and time.monotonic() - self._asked_at > OLD_S:
                    self._asked = self._tell_actor("state")
                    self._asked_at = time.monotonic()
        except ray.exceptions.RayError:
            self._asked = None
            if not self._busy:  # else the job's own answer tells
                self._drop()
        there, told = self._actor is not None, self._told
        return WorkerState(
            number=self._number,
            warm=self._warm,
            busy=self._busy,
            pid=told.pid if there else None,
            node=told.node,
            memory_bytes=told.memory_bytes if there else 0,
        )

    def stop(self) -> None:
        """Ask its process to end."""
        with self._changing:
            if not self._stopped:
                self._tell_actor("stop")
            self._stopped = True
        self._warm = False

    def end(self, grace_s: float) -> None:
        """End its process, at the latest when the grace is over, and the actor."""
        import ray

        self.stop()
        with self._changing:
            ending = self._tell_actor("end", grace_s)
        if ending is not None:
            ray.wait([ending], timeout=grace_s + END_S)
        self._drop()

    def _make(self) -> Any:
        with self._changing:
            if self._stopped:
                raise CancelledError("stopped: no more workers are made")
            if self._actor is None:
                self._actor = self._actors.remote(*self._arguments)
            return self._actor

    def _drop(self) -> None:
        """Let go of the actor, and make sure that it does nothing more."""
        import ray

        with self._changing:
            actor, self._actor, self._asked, self._warm = self._actor, None, None, False
        if actor is not None and ray.is_initialized():
            ray.kill(actor, no_restart=True)

    def _wait(self, reference: Any) -> Any:
        """What a call gives, unless the worker or the job is wanted no more before that."""
        import ray

        while not ray.wait([reference], timeout=LOOK_S)[0]:
            if self._stopped:
                raise CancelledError("stopped before it was ready")
            if self._cancelled:
                raise cancelled()
        return ray.get(reference)

    def _exchange(self, job: bytes, limits: Limits, tell: Tell | None) -> bytes:
        import ray

        actor = self._make()
        if tell is None:
            answer: bytes = ray.get(actor.do.remote(self._serial, job, limits))
            return answer
        for reference in actor.stream.options(num_returns="streaming").remote(self._serial, job, limits):
            item = ray.get(reference)
            if isinstance(item, bytes):
                return item
            tell(item)
        raise WorkerError("its worker ended without an answer: the job may go well another time")

    def _tell_actor(self, verb: str, *values: float) -> Any:
        """Call the actor beside its jobs, if there is one; gives what to wait for."""
        if self._actor is None:
            return None
        return getattr(self._actor, verb).options(concurrency_group=CONTROL).remote(*values)

    def _failed(self, error: StereoError) -> Answer:
        return Answer(result=None, error=error, seconds=0.0, worker=self._number)


def _why(error: Exception) -> str:
    """The first sentence of one of Ray's errors, which go on for a page."""
    return f"{in_one_line(error).split(': ', 1)[-1].split('. ')[0]:.120}"
