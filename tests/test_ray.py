"""A Ray cluster that is started here: closed to strangers, one for all of a process, its lost workers made again."""

import importlib.util
import os
import signal
import subprocess
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest
import worker_tasks

from stereo_gpu.cli import main
from stereo_gpu.engines import crew, ray_worker
from stereo_gpu.engines.executor import Work
from stereo_gpu.engines.ray_connection import _refuse_open_dashboard
from stereo_gpu.errors import InputError, WorkerError

SOON_S = 60.0
STRANGER = "import ray, sys; ray.init(address=sys.argv[1], log_to_driver=False); print('in')"


def wait_for(condition, seconds=SOON_S):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


@pytest.fixture(scope="module")
def psutil():
    import psutil

    return psutil


@pytest.fixture
def opened(ray_cluster):
    from stereo_gpu.engines.ray_cluster import RayExecutor

    executors = []

    def open_one(task, *, workers=1, num_cpus=1, **work):
        executors.append(RayExecutor(Work(task=task, **work), workers=workers, num_cpus=num_cpus))
        return executors[-1]

    yield open_one
    for executor in executors:
        executor.close(0.0)


def test_a_cluster_of_ours_lets_no_stranger_in(ray_cluster):
    import ray

    address = ray.get_runtime_context().gcs_address
    assert len(os.environ["RAY_AUTH_TOKEN"]) >= 32 or "RAY_AUTH_TOKEN_PATH" in os.environ
    unknown = {name: value for name, value in os.environ.items() if not name.startswith("RAY_")}
    stranger = subprocess.Popen(
        [sys.executable, "-c", STRANGER, address], env=unknown, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    try:
        said = b""
        while b"InvalidAuthToken" not in said and b"in\n" not in said:
            line = stranger.stdout.readline()
            assert line, said  # it has ended
            said += line
    finally:
        stranger.kill()
        stranger.wait()
        stranger.stdout.close()
    assert b"InvalidAuthToken" in said and b"in\n" not in said


def test_it_has_no_dashboard_and_tells_nobody(ray_cluster):
    import ray

    assert not ray._private.worker._global_node.webui_url and os.environ["RAY_USAGE_STATS_ENABLED"] == "0"


def test_a_process_works_with_one_cluster(opened):
    from stereo_gpu.engines.ray_cluster import RayExecutor

    with pytest.raises(InputError, match="works with the Ray cluster it started already"):
        RayExecutor(Work(task=worker_tasks.double), workers=1, address="auto")
    executors = [opened(worker_tasks.double), opened(worker_tasks.array_of)]
    assert executors[0].submit((4,)).answer.result(SOON_S).result == 8
    executors[0].close()
    assert "TypeError" in str(executors[1].submit((1,)).answer.result(SOON_S).error)  # it lives on for the other


def test_answers_are_the_callers_own(opened):
    import numpy as np

    executor = opened(worker_tasks.double)
    answer = executor.submit((np.arange(300_000, dtype=np.float32),)).answer.result(SOON_S)
    answer.result[0] = 7
    assert answer.result[-1] == 2 * 299_999
    refused = executor.submit((lambda: None,)).answer.result(SOON_S)
    assert "cannot be sent" in str(refused.error)


def test_an_actor_that_is_lost_is_made_again(opened, psutil):
    executor = opened(worker_tasks.sleep_then)
    _, pid = executor.submit((0.0, "first")).answer.result(SOON_S).result
    actor = psutil.Process(pid).ppid()
    running = executor.submit((30.0, "lost"))
    wait_for(lambda: executor.workers()[0].busy)
    time.sleep(0.3)
    os.kill(actor, signal.SIGKILL)
    lost = running.answer.result(SOON_S)
    assert isinstance(lost.error, WorkerError) and "was lost" in str(lost.error) and "\n" not in str(lost.error)
    assert executor.submit((0.0, "next")).answer.result(SOON_S).result[0] == "next"
    wait_for(lambda: not psutil.pid_exists(pid))  # what it had supervised does not go on


def test_a_loss_is_noticed_while_nothing_is_to_do(opened, psutil, monkeypatch):
    monkeypatch.setattr(crew, "AGAIN_S", 0.2)
    monkeypatch.setattr(ray_worker, "OLD_S", 0.1)
    executor = opened(worker_tasks.sleep_then)
    executor.start()
    wait_for(lambda: executor.workers()[0].warm)
    pid = executor.workers()[0].pid
    os.kill(psutil.Process(pid).ppid(), signal.SIGKILL)
    wait_for(lambda: executor.workers()[0].warm and executor.workers()[0].pid != pid)
    assert executor.submit((0.0, "well")).answer.result(SOON_S).error is None


def test_one_that_cannot_get_ready_makes_room_for_another(opened):
    by_worker = [{"broken": True}, {"broken": False}]
    options = {"prepare": worker_tasks.refuse_to_prepare, "by_worker": by_worker}
    executor = opened(worker_tasks.which, workers=2, num_cpus=2, **options)  # of 2 that there are
    assert executor.submit((1,)).answer.result(SOON_S).result == (1, False)


def test_what_no_node_has_is_refused(opened):
    with pytest.raises(InputError, match="no node of the Ray cluster has 500 CPU and 0 GPU"):
        opened(worker_tasks.double, num_cpus=500)


def test_without_ray_it_is_said_how_to_get_it(monkeypatch, raw_folder, tmp_path, capsys):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    arguments = ["batch", raw_folder, "--rig", raw_folder / "rig.json", "--out", tmp_path / "out", "--engine", "ray"]
    assert main([*map(str, arguments)]) == 2
    assert 'pip install "stereo-gpu[ray]"' in capsys.readouterr().err


@pytest.fixture
def dashboard():
    """Where something answers beyond loopback, as a dashboard does, and what sets its status."""

    class Answer(BaseHTTPRequestHandler):
        status = 200

        def do_GET(self):
            self.send_response(200 if "Authorization" in self.headers else self.status)
            self.end_headers()

        def log_message(self, *_):
            pass

    with HTTPServer(("127.0.0.1", 0), Answer) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        yield f"0.0.0.0:{server.server_port}", lambda status: setattr(Answer, "status", status)
        server.shutdown()
        thread.join()


def test_a_dashboard_that_is_open_to_all_is_refused(monkeypatch, dashboard):
    where, answer = dashboard
    for closed in ("", "127.0.0.1:8265", "localhost:8265", "[::1]:8265"):
        _refuse_open_dashboard(closed)
    monkeypatch.setenv("RAY_AUTH_MODE", "token")  # ours, which says nothing of the cluster's
    with pytest.raises(InputError, match="open to the network without a token"):
        _refuse_open_dashboard(where)
    for status in (401, 403):
        answer(status)
        _refuse_open_dashboard(where)
