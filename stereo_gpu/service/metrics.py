"""What an operator watches, in Prometheus' words; each service has a registry of its own."""

from __future__ import annotations

import logging
import shutil
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from prometheus_client import CollectorRegistry, Counter, Histogram, ProcessCollector, generate_latest
from prometheus_client.core import GaugeMetricFamily, Metric
from prometheus_client.exposition import CONTENT_TYPE_LATEST
from prometheus_client.registry import Collector

from stereo_gpu.engines.executor import Executor
from stereo_gpu.service.records import Kind, State

MEDIA_TYPE = CONTENT_TYPE_LATEST
_STAGE_SECONDS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1, 3, 10, 30, 100)
_JOB_SECONDS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500)
_WAIT_SECONDS = (0.01, 0.1, 1, 10, 60, 600, 3600, 36_000)

log = logging.getLogger("stereo_gpu.service")


class Metrics:
    """Counters that others raise, and gauges that are asked for when somebody looks.

    Args:
        counts: how many jobs are in each state.
        executor: whose workers are watched.
        data: the service's folder, whose disk is watched.
    """

    def __init__(self, counts: Callable[[], Mapping[State, int]], executor: Executor, data: Path) -> None:
        self.registry = CollectorRegistry()
        self._device_free: dict[str, int] = {}
        registry = self.registry
        self._accepted = Counter("stereo_gpu_jobs_accepted", "Jobs taken into the queue.", ["kind"], registry=registry)
        self._ended = Counter("stereo_gpu_jobs_ended", "Jobs that ended, by how.", ["kind", "state"], registry=registry)
        self._lost = Counter("stereo_gpu_tries_lost", "Tries that were lost, by why.", ["reason"], registry=registry)
        self._received = Counter("stereo_gpu_upload_bytes", "Bytes of pictures and rigs taken.", registry=registry)
        self._stage = Histogram(
            "stereo_gpu_stage_seconds",
            "Seconds that a stage took.",
            ["stage"],
            buckets=_STAGE_SECONDS,
            registry=registry,
        )
        self._job = Histogram(
            "stereo_gpu_job_seconds",
            "Seconds that a job took a worker.",
            ["kind"],
            buckets=_JOB_SECONDS,
            registry=registry,
        )
        self._wait = Histogram(
            "stereo_gpu_job_wait_seconds",
            "Seconds from the queue to a worker.",
            buckets=_WAIT_SECONDS,
            registry=registry,
        )
        ProcessCollector(registry=registry)  # memory, files and CPU seconds of the server itself
        self.registry.register(_Gauges(counts, executor, data, self._device_free))

    def accepted(self, kind: Kind) -> None:
        """A job came into the queue."""
        self._accepted.labels(str(kind)).inc()

    def received(self, size: int) -> None:
        """So many bytes of an upload were kept."""
        self._received.inc(size)

    def waited(self, seconds: float) -> None:
        """A job waited so long for its worker."""
        self._wait.observe(max(0.0, seconds))

    def ended(self, kind: Kind, state: State, seconds: Mapping[str, float]) -> None:
        """A job ended; `seconds` are those of its stages, and "total"."""
        self._ended.labels(str(kind), str(state)).inc()
        for stage, took in seconds.items():
            if stage == "total":
                self._job.labels(str(kind)).observe(took)
            else:
                self._stage.labels(stage).observe(took)

    def lost(self, reason: str) -> None:
        """A try was lost: reason is worker (it died, or went over a limit), device, result, begin or stopped."""
        self._lost.labels(reason).inc()

    def device(self, name: str, free_bytes: int) -> None:
        """A worker told how much memory its device has left."""
        self._device_free[name] = free_bytes

    def page(self) -> bytes:
        """All of it as Prometheus reads it, of type MEDIA_TYPE."""
        return generate_latest(self.registry)


class _Gauges(Collector):
    """What is measured at the moment that somebody looks."""

    def __init__(
        self,
        counts: Callable[[], Mapping[State, int]],
        executor: Executor,
        data: Path,
        device_free: Mapping[str, int],
    ) -> None:
        self._counts, self._executor, self._data, self._device_free = counts, executor, data, device_free

    def describe(self) -> list[Metric]:
        """Nothing: the registry would else ask for the values before there are any."""
        return []

    def collect(self) -> Iterator[Metric]:
        for gauges in (self._jobs, self._workers, self._disk):
            # A disk that fails must not take the rest of the figures with it, which may tell why.
            try:
                yield from list(gauges())
            except Exception:
                log.exception("some metrics cannot be had")

    def _jobs(self) -> Iterator[Metric]:
        jobs = GaugeMetricFamily("stereo_gpu_jobs", "Jobs that are kept, by state.", labels=["state"])
        counts = self._counts()
        for state in State:
            jobs.add_metric([str(state)], counts.get(state, 0))
        yield jobs
        yield GaugeMetricFamily("stereo_gpu_queue", "Jobs that wait.", value=counts.get(State.QUEUED, 0))

    def _workers(self) -> Iterator[Metric]:
        states = self._executor.workers()
        yield GaugeMetricFamily("stereo_gpu_worker_slots", "Workers that there should be.", value=self._executor.slots)
        for name, told, count in (
            ("warm", "Workers that can begin a job at once.", sum(state.warm for state in states)),
            ("busy", "Workers that have a job.", sum(state.busy for state in states)),
        ):
            yield GaugeMetricFamily(f"stereo_gpu_workers_{name}", told, value=count)
        memory = GaugeMetricFamily(
            "stereo_gpu_worker_memory_bytes", "Resident memory of a worker and all that it started.", labels=["worker"]
        )
        for state in states:
            memory.add_metric([str(state.number)], state.memory_bytes)
        yield memory
        if self._device_free:
            free = GaugeMetricFamily(
                "stereo_gpu_device_free_bytes", "Memory that a GPU had left after its last job.", labels=["device"]
            )
            for device, left in dict(self._device_free).items():
                free.add_metric([device], left)
            yield free

    def _disk(self) -> Iterator[Metric]:
        yield GaugeMetricFamily(
            "stereo_gpu_disk_free_bytes",
            "Room on the disk of the data folder.",
            value=shutil.disk_usage(self._data).free,
        )
