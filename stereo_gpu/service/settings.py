"""What an operator decides; every default suits a person on one machine."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

MEGABYTE = 1 << 20


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How the service runs.

    Args:
        data: the folder of all that it keeps.
        host, port: where it listens; only this machine reaches the usual address.
        engine: "inline", "local" or "ray".
        address: of the Ray cluster; None starts one here.
        workers: how many; None for what suits the device, as in `reconstruct_many`.
        backend: where to compute; None for the best device.
        job_seconds, job_memory_mb: what a job may take; None for no limit.
        tries: after so many lost ones a job has failed.
        lease_seconds: after so long without a heartbeat a job is somebody else's.
        queue_limit: jobs that may wait, of all clients together; more are answered 429.
        client_limit: jobs of one client that may wait.
        file_mb: largest picture, as a file.
        request_mb: largest request, all of its files together.
        megapixels: largest picture, by its header.
        upload_seconds, idle_seconds: what a request may take in all, and without a byte.
        keep_days, keep_gb: how long ended jobs are kept, and how much room they may take, the oldest go first.
        spare_gb: with less room on the disk than this nothing is taken.
        grace_seconds: what jobs under way get at a stop.
        link: what people open, where a proxy stands before the service; None for the address it listens at.
    """

    data: Path
    host: str = "127.0.0.1"
    port: int = 8000
    engine: str = "local"
    address: str | None = None
    workers: int | None = None
    backend: str | None = None
    job_seconds: float | None = 600.0
    job_memory_mb: int | None = None
    tries: int = 3
    lease_seconds: float = 30.0
    queue_limit: int = 10_000
    client_limit: int = 5_000
    file_mb: int = 64
    request_mb: int = 512
    megapixels: float = 50.0
    upload_seconds: float = 300.0
    idle_seconds: float = 20.0
    keep_days: float = 30.0
    keep_gb: float = 50.0
    spare_gb: float = 1.0
    grace_seconds: float = 30.0
    link: str | None = None
