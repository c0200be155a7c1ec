"""Who of a crew of processes takes a job, and what becomes of the line when some of them die."""

import os
import random
import signal
import sys
import threading
import time
from contextlib import suppress
from dataclasses import replace

import pytest
import worker_tasks

from stereo_gpu.engines import crew as crew_module
from stereo_gpu.engines.crew import Crew
from stereo_gpu.engines.executor import Limits, Work
from stereo_gpu.engines.in_order import run_in_order
from stereo_gpu.engines.inline import InlineWorker
from stereo_gpu.engines.local import LocalExecutor
from stereo_gpu.errors import CancelledError, WorkerError

SOON_S = 30.0


@pytest.fixture
def opened():
    """Opens local executors, and closes them."""
    executors = []

    def open_one(task, workers, **work):
        executors.append(LocalExecutor(Work(task=task, **work), workers))
        return executors[-1]

    yield open_one
    for executor in executors:
        executor.close(0.0)


def wait_for(condition):
    deadline = time.monotonic() + SOON_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_a_warm_worker_is_taken_before_a_cold_one(opened):
    executor = opened(worker_tasks.double, 4)
    assert not any(worker.pid for worker in executor.workers())
    for number in range(5):
        assert executor.submit((number,)).answer.result(SOON_S).result == 2 * number
    assert sum(worker.warm for worker in executor.workers()) == 1


def test_jobs_that_wait_start_as_many_as_they_need(opened, tmp_path):
    executor = opened(worker_tasks.meet, 4)
    jobs = [executor.submit((tmp_path, 2)) for _ in range(2)]
    assert len({job.answer.result(SOON_S).result for job in jobs}) == 2
    assert sum(worker.warm for worker in executor.workers()) == 2


def test_no_job_is_forgotten_by_many_workers():
    """Sixteen workers that all wake one another; each is a thread here, so that it is quick."""
    work = Work(task=worker_tasks.double)
    before = set(threading.enumerate())
    crew = Crew("threads", [InlineWorker(work) for _ in range(16)])
    found = {}

    def ask(first):
        for start in range(first, first + 300, 30):
            jobs = {value: crew.submit((value,)) for value in range(start, start + start % 29 + 1)}
            found.update({value: job.answer.result(SOON_S).result for value, job in jobs.items()})

    askers = [threading.Thread(target=ask, args=(1000 * number,)) for number in range(4)]
    for asker in askers:
        asker.start()
    for asker in askers:
        asker.join()
    crew.close()
    assert len(found) > 500 and all(result == 2 * value for value, result in found.items())
    assert not [new for new in set(threading.enumerate()) - before if new.name.startswith("stereo-gpu")]


class Roomless(InlineWorker):
    """A worker for which a cluster finds no room until it is ended; see `RayWorker`."""

    def __init__(self, work):
        super().__init__(work)
        self._ended = threading.Event()

    def warm(self):
        self._ended.wait()
        raise CancelledError("stopped before it was ready")

    def stop(self):
        self._ended.set()
        super().stop()


class Dying(InlineWorker):
    """A worker that is lost with its second job."""

    begun = 0

    def do(self, job, *rest):
        self.begun += 1
        answer = super().do(job, *rest)
        return replace(answer, result=None, error=WorkerError("lost")) if self.begun == 2 else answer


def test_one_without_room_keeps_no_job_waiting(monkeypatch):
    monkeypatch.setattr(crew_module, "AGAIN_S", 0.1)
    work = Work(task=worker_tasks.double)
    crew = Crew("threads", [Dying(work), Roomless(work)])
    assert [answer.result for answer in run_in_order(crew, [(1,), (2,)], tries=2)] == [2, 4]


def test_where_none_gets_ready_one_without_room_keeps_no_failure_back(monkeypatch):
    monkeypatch.setattr(crew_module, "AGAIN_S", 0.1)
    work = Work(task=worker_tasks.double, prepare=sys.exit)
    crew = Crew("threads", [InlineWorker(work), Roomless(work)])
    crew.start()
    answers = list(run_in_order(crew, [(1,), (2,)]))
    assert all("cannot get ready" in str(answer.error) for answer in answers)


@pytest.mark.parametrize("broken", [0, 1])
def test_one_that_cannot_get_ready_fails_no_job_that_another_can_do(opened, caplog, broken):
    by_worker = [{"broken": number == broken} for number in range(2)]
    executor = opened(worker_tasks.which, 2, prepare=worker_tasks.refuse_to_prepare, by_worker=by_worker)
    assert executor.submit((7,)).answer.result(SOON_S).result == (7, False)  # whoever is asked first
    executor.start()
    answers = [executor.submit((number,)) for number in range(40)]
    assert [job.answer.result(SOON_S).result for job in answers] == [(number, False) for number in range(40)]
    wait_for(lambda: f"worker {broken} cannot be made ready" in caplog.text)


def test_one_that_dies_idle_is_warmed_again(opened, monkeypatch):
    monkeypatch.setattr(crew_module, "AGAIN_S", 0.1)
    executor = opened(worker_tasks.double, 1)
    executor.start()
    wait_for(lambda: executor.workers()[0].warm)
    first = executor.workers()[0].pid
    os.kill(first, signal.SIGKILL)
    wait_for(lambda: executor.workers()[0].warm and executor.workers()[0].pid != first)


def test_workers_killed_at_random_lose_nothing(opened):
    """Each job has one answer, and those that are tried again all go well."""
    executor = opened(worker_tasks.sleep_then, 2)
    executor.start()
    chance = random.Random(7)
    over = threading.Event()
    killed = []

    def kill():
        while not over.wait(chance.uniform(0.1, 0.4)):
            pid = executor.workers()[chance.randrange(2)].pid
            if pid is not None and len(killed) < 8:
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
                    killed.append(pid)

    killer = threading.Thread(target=kill)
    killer.start()
    begun = []
    try:
        answers = list(
            run_in_order(
                executor,
                [(0.03, number) for number in range(80)],
                limits=Limits(seconds=SOON_S),
                tries=9,  # one more than are killed
                began=lambda index, worker: begun.append(index),
            )
        )
    finally:
        over.set()
        killer.join()
    assert [answer.result[0] for answer in answers] == list(range(80))
    assert killed and set(begun) == set(range(80)) and 80 <= len(begun) <= 80 + len(killed)
