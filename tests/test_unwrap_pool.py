"""The child processes of xatlas: what becomes of them and of their answers when they stop, crash or are left alone."""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from surfaces import CENTRE, ball, seen, triangulated

import stereo_gpu
from stereo_gpu import unwrap as unwrap_module
from stereo_gpu.errors import InputError
from stereo_gpu.mesh import build_mesh
from stereo_gpu.unwrap import unwrap
from stereo_gpu.unwrapping.child import Child, NoAnswerError, Question
from stereo_gpu.unwrapping.pool import PROCESSES, WorkerPool, _how_many, shared_pool

pytestmark = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks at processes through /proc")


@pytest.fixture
def pool(monkeypatch):
    """Two children of the test's own."""
    pool = WorkerPool(2)
    monkeypatch.setattr(unwrap_module, "shared_pool", lambda: pool)
    yield pool
    pool.close()


@pytest.fixture(scope="module")
def scene():
    """A ball before a wall, 5,000 triangles, and where the view sees its vertices."""
    surface = build_mesh(*triangulated(ball(51, 61, radius=50.0)), method="dense", centre=CENTRE)
    return surface, seen(surface.vertices)


def sheet(side=12, height=0.0, roughness=0.0):
    """A tile for xatlas: a grid, with a ridge if it has a height; if it is large and rough, it takes seconds."""
    x, y = np.meshgrid(np.arange(side, dtype=np.float32), np.arange(side, dtype=np.float32))
    positions = np.stack([x, y, height * np.abs(x - side // 2)], axis=-1).reshape(-1, 3)
    positions[:, 2] += np.random.default_rng(1).normal(0, roughness, side * side)
    first = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).reshape(-1, 1)
    faces = np.concatenate([first + np.array([0, side, 1]), first + np.array([1, side, side + 1])])
    return Question("charts", {"positions": positions.astype(np.float32), "faces": faces.astype(np.uint32)})


def state(pid):
    """R, S, T (stopped), Z (zombie); None where there is no such process."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except OSError:
        return None


def wait_until(holds, seconds=10.0):
    end = time.monotonic() + seconds
    while not holds() and time.monotonic() < end:
        time.sleep(0.02)
    return holds()


def pids(pool):
    return {child.process.pid for child in pool.children}


def test_answers_come_in_order_and_the_same_children_serve_again(pool):
    questions = [sheet(side) for side in (5, 12, 7, 9, 4)]
    answers = pool.ask(questions, time_limit_s=30)
    assert [len(answer["chart"]) for answer in answers] == [2 * (side - 1) ** 2 for side in (5, 12, 7, 9, 4)]
    assert all((answer["chart"] == 0).all() for answer in answers)
    ridge = pool.ask([sheet(12, height=2.0)], time_limit_s=30)[0]
    assert ridge["chart"].max() > 0
    before = pids(pool)
    pool.ask(questions, time_limit_s=30)
    assert pids(pool) >= before and len(pids(pool)) <= 2


def test_a_child_that_hangs_is_killed_at_its_limit_and_loses_only_its_tile(pool):
    pool.ask([sheet(), sheet()], time_limit_s=30)
    stopped = next(child.process for child in pool.children)
    os.kill(stopped.pid, signal.SIGSTOP)
    start = time.monotonic()
    answers = pool.ask([sheet() for _ in range(6)], time_limit_s=30, question_limit_s=1.0)
    assert time.monotonic() - start < 15
    lost = [str(answer) for answer in answers if isinstance(answer, NoAnswerError)]
    assert lost == ["xatlas took more than 1 s"]
    assert state(stopped.pid) is None, "it is left as a zombie, or alive"
    answers = pool.ask([sheet() for _ in range(4)], time_limit_s=30)
    assert not any(isinstance(answer, NoAnswerError) for answer in answers)


def test_a_crash_amid_a_question_loses_only_its_tile(pool):
    """It is killed once it has begun to work on a tile that takes long."""
    pool.ask([sheet(), sheet()], time_limit_s=30)
    before = pids(pool)
    answers = []
    asking = threading.Thread(
        target=lambda: answers.extend(pool.ask([sheet(90, roughness=0.3), sheet(), sheet()], time_limit_s=60))
    )
    busy = {child.process.pid: cpu_ticks(child.process.pid) for child in pool.children}
    asking.start()
    assert wait_until(lambda: any(cpu_ticks(pid) > ticks + 5 for pid, ticks in busy.items()))
    victim = max(busy, key=lambda pid: cpu_ticks(pid) - busy[pid])
    os.kill(victim, signal.SIGKILL)
    asking.join(timeout=60)
    assert [isinstance(answer, NoAnswerError) for answer in answers] == [True, False, False]
    assert str(answers[0]) == "xatlas ended with status -9: it said nothing"
    assert victim in before and victim not in pids(pool) and state(victim) is None


def cpu_ticks(pid):
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    except OSError:
        return 0
    return int(fields[11]) + int(fields[12])


def test_a_child_killed_while_it_waits_is_replaced(pool):
    pool.ask([sheet(), sheet()], time_limit_s=30)
    for pid in pids(pool):
        os.kill(pid, signal.SIGKILL)
    assert wait_until(lambda: not any(child.alive for child in pool.children))
    answers = pool.ask([sheet() for _ in range(4)], time_limit_s=30)
    assert not any(isinstance(answer, NoAnswerError) for answer in answers)


def test_an_error_is_told_and_the_child_goes_on(pool):
    wrong = Question("charts", {"positions": np.zeros((3, 3), np.float32), "faces": np.array([[0, 1, 9]], np.uint32)})
    (answer,) = pool.ask([wrong], time_limit_s=30)
    assert str(answer).startswith("xatlas failed: ") and "\n" not in str(answer)
    before = pids(pool)
    pool.ask([sheet()], time_limit_s=30)
    assert pids(pool) == before


def test_many_threads_share_the_children(pool):
    sides = range(4, 16)
    got = {}

    def ask(side):
        got[side] = [len(answer["chart"]) for answer in pool.ask([sheet(side)] * 3, time_limit_s=60)]

    threads = [threading.Thread(target=ask, args=(side,)) for side in sides]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert got == {side: [2 * (side - 1) ** 2] * 3 for side in sides}
    assert len(pids(pool)) <= 2


def test_tiles_without_an_answer_take_the_view_and_the_result_says_so(pool, scene, monkeypatch):
    monkeypatch.setattr("stereo_gpu.unwrapping.charts._FACES_PER_TILE", 600)
    surface, view_uv = scene
    whole = unwrap(surface, view_uv)
    assert (whole.method, whole.reason) == ("xatlas", None)
    os.kill(next(child.process.pid for child in pool.children), signal.SIGSTOP)
    part = unwrap(surface, view_uv, time_limit_s=4)
    assert part.method == "xatlas"
    assert part.reason.startswith("the view's own coordinates instead of charts in 1 of ")
    assert part.reason.endswith(" tiles: xatlas took more than 1.5 s")
    np.testing.assert_array_equal(part.vertex_map[part.faces], surface.faces)
    offset = part.uv.astype(float) * part.size - 0.5 - view_uv[part.vertex_map]
    np.testing.assert_allclose(offset, np.rint(offset), atol=1e-3)


def test_the_time_of_all_questions_is_bounded(pool):
    pool.ask([sheet(), sheet()], time_limit_s=30)
    stopped = pids(pool)
    for pid in stopped:
        os.kill(pid, signal.SIGSTOP)
    start = time.monotonic()
    answers = pool.ask([sheet() for _ in range(6)], time_limit_s=0.5)
    assert time.monotonic() - start < 5
    assert {str(answer) for answer in answers} == {"xatlas did not finish in 0.5 s"}
    assert [state(pid) for pid in stopped] == [None, None]


def test_a_process_that_cannot_start_gives_the_view_and_the_reason(pool, scene, monkeypatch, tmp_path):
    surface, view_uv = scene
    empty = tmp_path / "unwrap_worker.py"
    empty.write_text("import a_package_that_is_not_there")
    for executable, worker, reason in (
        (str(tmp_path / "python"), empty, "the process for xatlas cannot be started: No such file or directory"),
        (sys.executable, empty, "xatlas ended with status 1: ModuleNotFoundError: No module named 'a_package_that"),
    ):
        monkeypatch.setattr(sys, "executable", executable)
        monkeypatch.setattr("stereo_gpu.unwrapping.child._WORKER", worker)
        view = unwrap(surface, view_uv)
        assert view.method == "view"
        assert view.reason.startswith(f"the view's own coordinates instead of charts: {reason}")
    assert not pool.children


SCRIPT = """
import sys, time
import numpy as np
from stereo_gpu.types import Surface
from stereo_gpu.unwrap import unwrap
from stereo_gpu.unwrapping.pool import shared_pool
vertices = np.array([[0, 0, 9], [0, 4, 9], [4, 4, 9], [4, 0, 9]], np.float32)
faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
print(unwrap(Surface(vertices=vertices, faces=faces), vertices[:, :2] * 10).method)
print(*(child.process.pid for child in shared_pool().children), flush=True)
if sys.argv[1:]:
    time.sleep(60)
"""


def run_script(path, *arguments):
    path.write_text(SCRIPT)
    where = {**os.environ, "PYTHONPATH": str(Path(stereo_gpu.__file__).parents[1])}
    return subprocess.Popen([sys.executable, path, *arguments], stdout=subprocess.PIPE, text=True, env=where)


@pytest.mark.parametrize("way", ["ends", "is killed"])
def test_children_end_with_their_parent(tmp_path, way):
    """The script has no main guard: a child made by multiprocessing would run the whole of it again."""
    with run_script(tmp_path / "script.py", *(["wait"] if way == "is killed" else [])) as parent:
        assert parent.stdout.readline() == "xatlas\n"
        children = [int(pid) for pid in parent.stdout.readline().split()]
        assert children
        if way == "is killed":
            assert all(state(pid) for pid in children)
            parent.kill()
        assert parent.wait(timeout=30) == (0 if way == "ends" else -signal.SIGKILL)
    assert wait_until(lambda: all(state(pid) in (None, "Z") for pid in children))


def unwrap_in_fork(scene, answer):
    surface, view_uv = scene
    answer.send((unwrap(surface, view_uv).method, pids(shared_pool())))


@pytest.mark.filterwarnings("ignore:This process .* is multi-threaded:DeprecationWarning")
def test_a_fork_starts_children_of_its_own(scene):
    surface, view_uv = scene
    assert unwrap(surface, view_uv).method == "xatlas"
    ours = pids(shared_pool())
    context = multiprocessing.get_context("fork")
    here, there = context.Pipe()
    fork = context.Process(target=unwrap_in_fork, args=(scene, there))
    fork.start()
    assert here.poll(60)
    method, theirs = here.recv()
    fork.join(30)
    assert method == "xatlas" and theirs and not theirs & ours
    assert wait_until(lambda: all(state(pid) in (None, "Z") for pid in theirs))
    assert unwrap(surface, view_uv).method == "xatlas" and pids(shared_pool()) >= ours


@pytest.mark.parametrize("given", ["0", "two", "-1", ""])
def test_a_wrong_number_of_processes(given, monkeypatch):
    monkeypatch.setenv(PROCESSES, given)
    monkeypatch.setattr("stereo_gpu.unwrapping.pool._pool", None)
    with pytest.raises(InputError, match="STEREO_GPU_UNWRAP_PROCESSES is "):
        shared_pool()


def test_the_number_of_processes(monkeypatch):
    monkeypatch.setenv(PROCESSES, "3")
    assert _how_many() == 3
    monkeypatch.delenv(PROCESSES)
    monkeypatch.delenv("STEREO_GPU_PROCESSES", raising=False)
    assert _how_many() == len(os.sched_getaffinity(0))
    monkeypatch.setenv("STEREO_GPU_PROCESSES", "1000")  # as for a worker of a batch
    assert _how_many() == 1


def test_children_can_be_started_ahead(pool):
    pool.warm(1)
    before = pids(pool)
    assert len(before) == 1
    pool.warm(1)
    assert pids(pool) == before
    pool.warm(5)
    assert len(pids(pool)) == 2
    before = pids(pool)
    assert len(pool.ask([sheet(), sheet()], time_limit_s=30)) == 2 and pids(pool) == before


def test_a_process_that_cannot_be_started_ahead_is_told_when_it_is_asked(pool, monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    pool.warm(2)
    assert not pool.children
    (answer,) = pool.ask([sheet()], time_limit_s=30)
    assert str(answer) == "the process for xatlas cannot be started: No such file or directory"


def test_a_child_that_nobody_stops_ends_by_itself():
    """As one whose parent was killed while it hung: Python's lock is xatlas', so only a signal can end it."""
    child = Child()
    try:
        assert child.exchange(sheet(150, roughness=0.3), 0.0) is None
        assert child.process.returncode == -signal.SIGALRM
    finally:
        child.end()
