"""What Prometheus reads."""

import sys

from conftest import need_service

need_service()

from prometheus_client.parser import text_string_to_metric_families  # noqa: E402

from stereo_gpu.engines.executor import Work  # noqa: E402
from stereo_gpu.engines.inline import InlineExecutor  # noqa: E402
from stereo_gpu.service.metrics import Metrics  # noqa: E402
from stereo_gpu.service.records import Kind, State  # noqa: E402


def read(metrics):
    families = text_string_to_metric_families(metrics.page().decode())
    return {(s.name, *sorted(s.labels.values())): s.value for family in families for s in family.samples}


def test_every_figure_that_an_operator_watches(tmp_path):
    counts = {State.QUEUED: 4, State.DONE: 2}
    executor = InlineExecutor(Work(task=print))
    metrics = Metrics(lambda: counts, executor, tmp_path)
    metrics.accepted(Kind.RECONSTRUCTION)
    metrics.received(1000)
    metrics.waited(0.5)
    metrics.waited(-1.0)  # a clock that was put back
    metrics.ended(Kind.RECONSTRUCTION, State.DONE, {"match": 0.02, "total": 0.2})
    metrics.lost("worker")
    metrics.device("warp:cuda:0", 7)
    told = read(metrics)
    assert told["stereo_gpu_jobs", "queued"] == told["stereo_gpu_queue",] == 4
    assert told["stereo_gpu_jobs", "done"] == 2 and told["stereo_gpu_jobs", "failed"] == 0
    assert told["stereo_gpu_jobs_accepted_total", "reconstruction"] == 1
    assert told["stereo_gpu_jobs_ended_total", "done", "reconstruction"] == 1
    assert told["stereo_gpu_tries_lost_total", "worker"] == 1
    assert told["stereo_gpu_upload_bytes_total",] == 1000
    assert told["stereo_gpu_stage_seconds_count", "match"] == 1
    assert told["stereo_gpu_job_seconds_sum", "reconstruction"] == 0.2
    assert (told["stereo_gpu_job_wait_seconds_count",], told["stereo_gpu_job_wait_seconds_sum",]) == (2, 0.5)
    assert (told["stereo_gpu_worker_slots",], told["stereo_gpu_workers_busy",]) == (1, 0)
    assert told["stereo_gpu_worker_memory_bytes", "0"] > 1e6
    assert told["stereo_gpu_device_free_bytes", "warp:cuda:0"] == 7
    assert told["stereo_gpu_disk_free_bytes",] > 0
    if sys.platform == "linux":
        assert told["process_resident_memory_bytes",] > 1e6
    executor.close()


def test_a_table_that_fails_takes_no_other_figure_with_it(tmp_path, caplog):
    def broken():
        raise OSError("the disk is gone")

    executor = InlineExecutor(Work(task=print))
    told = read(Metrics(broken, executor, tmp_path))
    assert ("stereo_gpu_queue",) not in told and told["stereo_gpu_worker_slots",] == 1
    assert "some metrics cannot be had" in caplog.text
    executor.close()


def test_two_services_count_apart(tmp_path):
    executor = InlineExecutor(Work(task=print))
    first, second = (Metrics(dict, executor, tmp_path) for _ in range(2))
    first.lost("worker")
    assert ("stereo_gpu_tries_lost_total", "worker") not in read(second)
    executor.close()
