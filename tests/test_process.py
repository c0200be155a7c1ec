"""One worker process: its start, its ends, and what it is told."""

import os
import signal
import subprocess
import sys
import threading
import time
import types
from pathlib import Path

import numpy as np
import pytest
import worker_tasks

from stereo_gpu.engines import process as process_module
from stereo_gpu.engines.executor import Limits, Work
from stereo_gpu.engines.process import WorkerProcess
from stereo_gpu.errors import CancelledError, StageError, WorkerError

SOON_S = 30.0


@pytest.fixture
def started():
    """Makes worker processes, and ends them."""
    made = []

    def make(task, count=1, environment=None, **work):
        made.append(WorkerProcess(Work(task=task, **work), 0, count, environment))
        return made[-1]

    yield make
    for worker in made:
        worker.end(0.0)


def gone(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False


def is_zombie(pid):
    """Whether it has ended, and whoever has inherited it has not waited for it yet."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return False


def wait_for(condition):
    deadline = time.monotonic() + SOON_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_its_start_is_no_part_of_a_job(started):
    worker = started(worker_tasks.answer, prepare=worker_tasks.prepare_slowly)
    assert not worker.state().warm and worker.state().pid is None
    answer = worker.do((1,), Limits(seconds=0.9))
    assert answer.result == 1 and answer.seconds < 0.9
    assert worker.state().warm and not worker.state().busy


def test_one_that_died_is_started_again(started):
    worker = started(worker_tasks.answer)
    worker.warm()
    first = worker.state().pid
    os.kill(first, signal.SIGKILL)
    wait_for(lambda: not worker.state().warm)
    assert worker.state().pid is None and worker.state().memory_bytes == 0
    assert worker.do((1,)).result == 1 and worker.state().pid not in (None, first)


def test_it_is_told_what_it_needs(started, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")  # the user's own stays
    worker = started(worker_tasks.environment, count=2, environment={"CUDA_VISIBLE_DEVICES": "3"})
    told = [worker.do((name,)).result for name in ("CUDA_VISIBLE_DEVICES", "OMP_NUM_THREADS", process_module.PROCESSES)]
    assert told == ["3", "7", "2"]


def test_what_cannot_be_started_says_so(started, monkeypatch):
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    answer = started(worker_tasks.answer).do((1,))
    assert isinstance(answer.error, WorkerError) and "cannot be started" in str(answer.error)
    assert "use fewer workers" in str(answer.error) and answer.result is None


def test_one_that_dies_on_its_way_says_when(started):
    worker = started(worker_tasks.misbehave, prepare=worker_tasks.misbehave, shared={"what": "leave"})
    with pytest.raises(WorkerError, match="exit status 3 before it was ready"):
        worker.warm()


def test_what_cannot_be_sent_is_a_fault_of_that_job_alone(started, monkeypatch):
    worker = started(worker_tasks.answer)
    assert "cannot be sent" in str(worker.do((lambda: None,)).error)
    # A class of a module that is here alone: it cannot be understood there, and the process goes on.
    only_here = types.ModuleType("only_here")
    only_here.Thing = type("Thing", (), {"__module__": "only_here"})
    monkeypatch.setitem(sys.modules, "only_here", only_here)
    before = worker.do((1,)) and worker.state().pid
    answer = worker.do((only_here.Thing(),))
    assert isinstance(answer.error, StageError) and "No module named 'only_here'" in str(answer.error)
    assert worker.do((2,)).result == 2 and worker.state().pid == before


def test_a_job_is_nobodys_input(started):
    worker = started(worker_tasks.read_input)
    assert [worker.do((), Limits(seconds=SOON_S)).result for _ in range(2)] == ["", ""]


def test_one_stopped_amid_an_import_was_cancelled_and_says_nothing(started, capfd):
    """An extension's import may make an error of its own of an exception, and tell it on stderr: none is raised."""
    worker = started(worker_tasks.answer, prepare=worker_tasks.fail_when_stopped)
    failed = []

    def warm():
        with pytest.raises(CancelledError) as raised:
            worker.warm()
        failed.append(raised.value)

    thread = threading.Thread(target=warm)
    thread.start()
    wait_for(lambda: worker.state().pid is not None)
    time.sleep(0.5)
    worker.end(SOON_S)
    thread.join(SOON_S)
    assert failed and capfd.readouterr().err == ""


def test_narrow_pipes_will_do(started, monkeypatch):
    """A user who is not root gets 64 MB of pipes in all; beyond that a pipe stays as it is."""
    import fcntl

    def refuse(*_):
        raise PermissionError("Operation not permitted")

    monkeypatch.setattr(fcntl, "fcntl", refuse)
    sent = np.arange(1 << 20)
    assert np.array_equal(started(worker_tasks.answer).do((sent,)).result, sent)


@pytest.mark.parametrize("how", ["cancel", "end"])
def test_one_that_does_not_listen_is_killed(started, tmp_path, how):
    worker = started(worker_tasks.hold_on)
    answers = []
    thread = threading.Thread(target=lambda: answers.append(worker.do((tmp_path / "pid",))))
    thread.start()
    wait_for(lambda: (tmp_path / "pid").exists() and (tmp_path / "pid").read_text())
    worker.cancel() if how == "cancel" else worker.end(0.2)
    thread.join(SOON_S)
    assert isinstance(answers[0].error, CancelledError)
    assert gone(int((tmp_path / "pid").read_text()))


def test_one_that_is_cancelled_leaves_nothing_half(started, tmp_path, capfd):
    worker = started(worker_tasks.leave_a_file)
    answers = []
    thread = threading.Thread(target=lambda: answers.append(worker.do((tmp_path / "folder", 30.0))))
    thread.start()
    wait_for(lambda: list(tmp_path.glob("*/.*.part/half")))
    worker.cancel()
    thread.join(SOON_S)
    assert isinstance(answers[0].error, CancelledError) and not list(tmp_path.iterdir())
    assert capfd.readouterr().err == ""
    assert worker.do((tmp_path / "folder", 0.0)).error is None


def test_a_stopped_one_does_nothing_more(started):
    worker = started(worker_tasks.answer)
    worker.warm()
    worker.stop()
    assert isinstance(worker.do((1,)).error, CancelledError)
    with pytest.raises(CancelledError):
        worker.warm()


PARENT = """
import sys
sys.path.insert(0, {tests!r})
import worker_tasks
from pathlib import Path
from stereo_gpu.engines.executor import Work
from stereo_gpu.engines.process import WorkerProcess
worker = WorkerProcess(Work(task=worker_tasks.leave_a_file), 0, 1)
worker.warm()
print(worker.state().pid, flush=True)
worker.do((Path({folder!r}), 60.0))
"""


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="this system does not tell of a parent's end")
def test_one_whose_parent_is_killed_ends_and_leaves_nothing_half(tmp_path):
    script = PARENT.format(tests=str(Path(__file__).parent), folder=str(tmp_path / "folder"))
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as parent:
        pid = int(parent.stdout.readline())
        wait_for(lambda: list(tmp_path.glob("*/.*.part/half")))
        parent.kill()
    wait_for(lambda: gone(pid) or is_zombie(pid))
    assert not list(tmp_path.iterdir())
