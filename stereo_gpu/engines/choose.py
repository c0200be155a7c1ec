"""The engine of a name."""

from __future__ import annotations

from stereo_gpu.engines.executor import ENGINES, Executor, Work
from stereo_gpu.engines.inline import InlineExecutor
from stereo_gpu.engines.local import LocalExecutor
from stereo_gpu.errors import InputError


def open_executor(
    name: str,
    work: Work,
    *,
    workers: int | None = None,
    address: str | None = None,
) -> Executor:
    """Open an executor; it starts nothing until it is asked to, or gets its first job.

    Args:
        name: "inline", "local" or "ray".
        work: what it does with every job.
        workers: how many; None for one a core. "inline" has one.
        address: of a Ray cluster; None has one started here, which ends with the executor.

    Raises:
        InputError: there is no such engine, it cannot have so many workers or has no address, or Ray is not installed.
    """
    if name not in ENGINES:
        raise InputError(f"engine {name!r:.40}: give {', '.join(ENGINES[:-1])} or {ENGINES[-1]}")
    if name == "ray":
        from stereo_gpu.engines.ray_cluster import RayExecutor

        return RayExecutor(work, workers=workers, address=address)
    if address is not None:
        raise InputError(
            f"address {address!r:.60} is of a Ray cluster, engine {name} works here: give engine ray, or none"
        )
    if name == "local":
        return LocalExecutor(work, workers)
    if workers not in (None, 1):
        raise InputError(f"workers = {workers!r:.60}: engine inline has one; leave it out, or give engine local")
    return InlineExecutor(work)
