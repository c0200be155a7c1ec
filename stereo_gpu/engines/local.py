"""Jobs in processes of this machine: several at once, and one that dies takes no other with it."""

from __future__ import annotations

from stereo_gpu.backends.share import usable_cores
from stereo_gpu.engines.crew import Crew
from stereo_gpu.engines.executor import Work
from stereo_gpu.engines.process import WorkerProcess
from stereo_gpu.errors import InputError

MOST_WORKERS = 1024  # more is a slip of the finger, for which no machine has the memory


class LocalExecutor(Crew):
    """Fulfils `executor.Executor` by processes of this machine, each with its share of the cores and the memory.

    A process that dies, whatever ends it, fails the job that it had; the next job gets a new one.

    Args:
        work: what is done with every job.
        workers: how many processes; None for one a core.

    Raises:
        InputError: `workers` is no number of processes.
    """

    def __init__(self, work: Work, workers: int | None = None) -> None:
        count = check_workers(workers)
        super().__init__("local", [WorkerProcess(work, number, count) for number in range(count)])


def check_workers(workers: int | None) -> int:
    """How many processes are wanted.

    Raises:
        InputError: as many cannot be.
    """
    count = min(usable_cores(), MOST_WORKERS) if workers is None else workers
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= MOST_WORKERS:
        raise InputError(
            f"workers = {workers!r:.60}: give a number of processes, 1 to {MOST_WORKERS}, or None for one a core"
        )
    return count
