"""Jobs on the nodes of a Ray cluster."""

from __future__ import annotations

import logging
import pickle
from collections.abc import Callable
from typing import Any

from stereo_gpu.backends.share import usable_cores
from stereo_gpu.engines.crew import Crew
from stereo_gpu.engines.executor import Work
from stereo_gpu.engines.local import MOST_WORKERS, check_workers
from stereo_gpu.engines.ray_connection import connect, release
from stereo_gpu.engines.ray_worker import RayWorker
from stereo_gpu.engines.watch import GRACE_S
from stereo_gpu.errors import InputError

GPU_SHARE = 0.125  # of a GPU, a worker: so many keep it busy while others of them decode, mesh and encode

logger = logging.getLogger(__name__)


class RayExecutor(Crew):
    """Fulfils `executor.Executor` by actors of a Ray cluster, each of which supervises a worker process on its node.

    A worker that is lost, with its actor or its whole node, fails the job that it had, and is made again where there
    is room. One for which no node has room waits until there is one; the others work meanwhile. Every node must have
    the same stereo-gpu installed, and see under one path what jobs name.

    Args:
        work: what is done with every job.
        workers: how many; None for as many as the cluster has room for now.
        address: as of `ray_connection.connect`.
        num_cpus: cores that a worker takes of its node.
        num_gpus: GPUs, parts too; None for an eighth where the cluster has any, else none.

    Raises:
        InputError: Ray is not installed, there is no such cluster, none of its nodes is large enough for a worker, or
            `work` cannot be sent.
    """

    def __init__(
        self,
        work: Work,
        *,
        workers: int | None = None,
        address: str | None = None,
        num_cpus: float = 1.0,
        num_gpus: float | None = None,
    ) -> None:
        if workers is not None:
            check_workers(workers)
        if not num_cpus > 0 or (num_gpus is not None and not num_gpus >= 0):
            raise InputError(f"num_cpus = {num_cpus!r}, num_gpus = {num_gpus!r}: give numbers, of cores above 0")
        try:
            pickled = pickle.dumps(work, protocol=5)
        except Exception as error:
            raise InputError(f"the work cannot be sent to another process: {error}") from error
        here = usable_cores() if workers is None else workers
        connect(address, max(1, round(here * num_cpus)))
        try:
            room, share = _room(num_cpus, num_gpus)
            count = min(room, MOST_WORKERS) if workers is None else workers
            if count > room:
                logger.warning("%d workers are wanted, the cluster has room for %d: the rest waits for it", count, room)
            super().__init__("ray", [RayWorker(pickled, number, num_cpus, share) for number in range(count)])
        except BaseException:
            release()
            raise
        self._release: Callable[[], None] | None = release

    def close(self, grace_s: float = GRACE_S) -> None:
        """End all workers, and leave the cluster."""
        super().close(grace_s)
        leave, self._release = self._release, None
        if leave is not None:
            leave()


def _room(num_cpus: float, num_gpus: float | None) -> tuple[int, float]:
    """For how many workers the cluster has room, and the part of a GPU that each takes."""
    import ray

    nodes: list[dict[str, Any]] = [node["Resources"] for node in ray.nodes() if node["Alive"]]
    if num_gpus is None:
        num_gpus = GPU_SHARE if any(node.get("GPU", 0) for node in nodes) else 0.0
    room = 0
    for node in nodes:
        fits = node.get("CPU", 0) / num_cpus
        room += int(min(fits, node.get("GPU", 0) / num_gpus) if num_gpus else fits)
    if not room:
        raise InputError(
            f"no node of the Ray cluster has {num_cpus:g} CPU and {num_gpus:g} GPU, which each worker takes: see"
            " `ray status`"
        )
    return room, num_gpus
