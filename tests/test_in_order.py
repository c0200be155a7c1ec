"""Jobs in processes of their own: in order, bounded, and one that dies takes no other with it."""

import os
import time

import numpy as np
import pytest
import worker_tasks

from stereo_gpu.backends.share import PROCESSES, usable_cores
from stereo_gpu.engines.executor import Limits, Work
from stereo_gpu.engines.in_order import WAITING_EACH, run_in_order
from stereo_gpu.engines.local import LocalExecutor
from stereo_gpu.errors import InputError, StageError, WorkerError


def gone(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False


def run_jobs(task, jobs, *, shared=None, workers, **options):
    return run_in_order(LocalExecutor(Work(task=task, shared=shared or {}), workers), jobs, **options)


def test_answers_come_in_the_order_of_the_jobs():
    jobs = [(0.3 if number == 0 else 0.0, number) for number in range(7)]
    executor = LocalExecutor(Work(task=worker_tasks.sleep_then), 2)
    executor.start()
    while not all(worker.warm for worker in executor.workers()):  # or one might do all of them
        time.sleep(0.01)
    answers = list(run_in_order(executor, jobs))
    assert [answer.result[0] for answer in answers] == list(range(7))
    assert len({answer.result[1] for answer in answers}) == 2
    assert answers[0].seconds > 0.3 and all(answer.error is None for answer in answers)
    assert all(gone(answer.result[1]) for answer in answers)


def test_one_that_fails_fails_alone_and_says_why():
    ways = ["well", "kill", "crash", "leave", "refuse", "fault", "unsendable", "print", "again"]
    answers = list(run_jobs(worker_tasks.misbehave, [(way,) for way in ways], workers=2))
    said = {way: str(answer.error) for way, answer in zip(ways, answers, strict=True)}
    assert [answer.result for answer in answers] == ["well", *[None] * 6, "print", "again"]
    assert "killed, as where memory runs out" in said["kill"]
    assert "signal SIGABRT" in said["crash"] and "exit status 3" in said["leave"]
    assert said["refuse"] == "the pair is bad" and isinstance(answers[4].error, InputError)
    assert "ZeroDivisionError: a fault" in said["fault"] and isinstance(answers[5].error, StageError)
    assert "worker_tasks.py" in answers[5].error.__notes__[0]
    assert "misbehave.<locals>.<lambda>" in said["unsendable"]


def test_one_that_hangs_is_given_up():
    jobs = [("hang",), ("well",)]
    hung, well = run_jobs(worker_tasks.misbehave, jobs, workers=1, limits=Limits(seconds=0.5))
    assert "took over 0.5 s" in str(hung.error) and well.result == "well"


def test_no_more_is_asked_for_than_is_taken():
    asked = []

    def jobs():
        for number in range(20):
            asked.append(number)
            yield (number,)

    answers = run_jobs(worker_tasks.double, jobs(), shared={"plus": 1}, workers=1)
    assert not asked
    for taken in range(3):
        assert next(answers).result == 2 * taken + 1
        assert len(asked) <= taken + WAITING_EACH
    answers.close()
    assert len(asked) < 20


def test_one_whose_worker_dies_is_tried_again_as_often_as_wanted(tmp_path):
    folders = [tmp_path / name for name in ("once", "twice", "always")]
    for folder in folders:
        folder.mkdir()
    jobs = list(zip(folders, (1, 2, 99), strict=True))
    begun = []
    answers = run_jobs(worker_tasks.die_at_first, jobs, workers=1, tries=3, began=lambda *told: begun.append(told))
    once, twice, always = answers
    assert (once.result, twice.result) == (2, 3) and isinstance(always.error, WorkerError)
    assert sorted(begun) == [(0, 0)] * 2 + [(1, 0)] * 3 + [(2, 0)] * 3
    # What fails by itself would fail again.
    (refused,) = run_jobs(worker_tasks.refuse_and_count, [(folders[0],)], workers=1, tries=3)
    assert isinstance(refused.error, InputError) and len(list(folders[0].iterdir())) == 3


def test_arrays_go_there_and_back():
    sent = np.arange(300_000, dtype=np.float32).reshape(3, -1)
    (answer,) = run_jobs(worker_tasks.double, [(sent,)], workers=1)
    assert np.array_equal(answer.result, 2 * sent)
    answer.result[0, 0] = 7  # it is the caller's own
    (large,) = run_jobs(worker_tasks.array_of, [(5_000_000,)], shared={"value": 9}, workers=1)
    assert large.result.shape == (5_000_000,) and (large.result == 9).all()


def test_stopping_early_cleans_up_and_ends_the_processes(tmp_path):
    answers = run_jobs(
        worker_tasks.leave_a_file,
        [(tmp_path / "first", 0.0), (tmp_path / "second", 30.0), (tmp_path / "third", 30.0)],
        workers=1,
    )
    next(answers)
    deadline = time.monotonic() + 10
    while not list(tmp_path.glob("**/*.part")):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    answers.close()
    assert sorted(file.relative_to(tmp_path).as_posix() for file in tmp_path.rglob("*")) == ["first", "first/half"]


def test_processes_that_let_go_of_something_end_quietly(tmp_path, capfd):
    (answer,) = run_jobs(worker_tasks.give_held, [()], workers=1)
    assert answer.result == 1
    # Stopped early, an end that comes then must not be lost: the process cleans up before it would be killed.
    jobs = [(tmp_path / "first", None), (tmp_path / "second", tmp_path / "started")]
    answers = run_jobs(worker_tasks.fill_and_let_go, jobs, workers=1)
    next(answers)
    deadline = time.monotonic() + 10
    while not (tmp_path / "started").exists():
        assert time.monotonic() < deadline
        time.sleep(0.01)
    answers.close()
    assert not (tmp_path / "second").exists() and capfd.readouterr().err == ""


def test_processes_share_the_cores(monkeypatch):
    monkeypatch.delenv("POCL_MAX_PTHREAD_COUNT", raising=False)
    names = [(PROCESSES,), ("POCL_MAX_PTHREAD_COUNT",)]
    told = [answer.result for answer in run_jobs(worker_tasks.environment, names, workers=3)]
    assert told == ["3", str(max(1, usable_cores() // 3))]
    monkeypatch.setenv(PROCESSES, str(10**6))
    assert usable_cores() == 1


@pytest.mark.parametrize("workers", [0, 10**8, 1.5, True])
def test_wrong_numbers_are_refused_at_once(workers):
    with pytest.raises(InputError, match="give a number"):
        LocalExecutor(Work(task=worker_tasks.double), workers)


@pytest.mark.parametrize("limit", [0, -1, float("nan"), "2"])
def test_wrong_limits_are_refused(limit):
    for limits in ({"seconds": limit}, {"memory_bytes": limit}):
        with pytest.raises(InputError, match="give a number above 0"):
            Limits(**limits)


@pytest.mark.parametrize("tries", [0, 1.5, True])
def test_wrong_tries_are_refused(tries):
    with pytest.raises(InputError, match="give a whole number above 0"):
        run_jobs(worker_tasks.double, [(1,)], workers=1, tries=tries)
