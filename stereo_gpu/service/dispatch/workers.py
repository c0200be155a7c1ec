"""Which workers the service has: how many, and on which device each computes."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from stereo_gpu.backends import devices, open_backend
from stereo_gpu.backends.share import usable_cores
from stereo_gpu.engines.choose import open_executor
from stereo_gpu.engines.executor import Executor, Work
from stereo_gpu.reconstruct_many import MOST_ON_A_GPU, how_many
from stereo_gpu.service.jobs.work import do_job, prepare
from stereo_gpu.service.settings import Settings


def open_workers(settings: Settings) -> Executor:
    """The executor of the service's jobs.

    Without a named device every GPU here is used, by as many workers as suit it; without a GPU there is one a core.
    Workers on other machines look for themselves.

    Raises:
        InputError: the engine or the number of workers is wrong.
        BackendError: the device is missing.
    """
    workers, by_worker = settings.workers, _devices(settings)
    if settings.engine == "local" and len(by_worker) == 1:
        workers = how_many(workers, open_backend(by_worker[0]["backend"]))
    elif settings.engine == "local" and workers is None:
        workers = min(usable_cores(), MOST_ON_A_GPU * len(by_worker))
    work = Work(
        task=do_job,
        shared={"data": settings.data.absolute()},
        prepare=prepare,
        tells=True,
        by_worker=by_worker,
    )
    return open_executor(settings.engine, work, workers=workers, address=settings.address)


def _devices(settings: Settings) -> list[Mapping[str, Any]]:
    """The device of each worker in turn."""
    named = settings.backend or os.environ.get("STEREO_GPU_BACKEND")
    if settings.engine == "ray":
        return [{"backend": settings.backend}]
    gpus = [status.name for status in devices() if status.kind == "gpu" and status.available] if named is None else []
    # A GPU of NVIDIA is listed twice, by Warp and by OpenCL.
    through_warp = [name for name in gpus if name.startswith("warp:")]
    names = through_warp or gpus or [open_backend(named).name]
    return [{"backend": name} for name in names]
