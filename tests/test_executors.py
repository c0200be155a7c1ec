"""What every engine promises, asked of each of them."""

import sys
import threading
import time
import traceback

import pytest
import worker_tasks

from stereo_gpu.engines.choose import open_executor
from stereo_gpu.engines.executor import ENGINES, Limits, Work
from stereo_gpu.engines.memory import MEMORY_IS_KNOWN, resident_memory
from stereo_gpu.errors import CancelledError, InputError, StageError, StereoError, WorkerError

SOON_S = 30.0  # more than anything here takes; a machine may be slow
MEGABYTE = 1 << 20


@pytest.fixture(params=ENGINES)
def engine(request):
    """The name of each engine that can be had."""
    if request.param == "ray":
        request.getfixturevalue("ray_cluster")
    return request.param


@pytest.fixture
def opened(engine):
    """Opens executors of this engine, with one worker inline and up to two elsewhere; closes them at the end."""
    executors = []

    def open_one(task, *, workers=1, **work):
        executor = open_executor(engine, Work(task=task, **work), workers=1 if engine == "inline" else workers)
        executors.append(executor)
        return executor

    yield open_one
    for executor in executors:
        executor.close(0.0)


def taken(running):
    return running.answer.result(SOON_S)


def wait_for(condition):
    deadline = time.monotonic() + SOON_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_each_job_has_its_answer(engine, opened):
    executor = opened(worker_tasks.double, workers=2, shared={"plus": 1})
    assert executor.name == engine and executor.slots == (1 if engine == "inline" else 2)
    begun = []
    jobs = [executor.submit((number,), began=begun.append) for number in range(20)]
    answers = [taken(job) for job in jobs]
    assert [answer.result for answer in answers] == [2 * number + 1 for number in range(20)]
    assert all(answer.error is None and 0 <= answer.seconds < SOON_S for answer in answers)
    assert sorted(begun) == sorted(answer.worker for answer in answers)
    assert set(begun) <= set(range(executor.slots))


def test_workers_are_warm_before_they_are_asked(opened):
    executor = opened(worker_tasks.prepared, workers=2, prepare=worker_tasks.prepare, shared={"mark": "both"})
    assert not any(worker.warm or worker.busy for worker in executor.workers())
    worker_tasks.PREPARED.clear()  # inline they are prepared in this process
    executor.start()
    wait_for(lambda: all(worker.warm for worker in executor.workers()))
    states = executor.workers()
    assert [state.number for state in states] == list(range(executor.slots))
    assert all(state.node for state in states)
    assert all(state.memory_bytes > 10 * MEGABYTE for state in states) or not MEMORY_IS_KNOWN
    for number in range(6):
        value, mark, done, pid = taken(executor.submit((number,))).result
        assert (value, mark, done) == (number, "both", ["both"])
        assert pid in {state.pid for state in states}


def test_a_job_that_comes_early_finds_a_warm_worker(opened):
    worker_tasks.PREPARED.clear()
    executor = opened(worker_tasks.prepared, prepare=worker_tasks.prepare, shared={"mark": "one"})
    assert taken(executor.submit((1,))).result[:3] == (1, "one", ["one"])


def test_stages_are_told_as_they_begin(opened):
    executor = opened(worker_tasks.go_through, tells=True)
    told = []
    stages = [("read", 0.0), ("match", 0.5), ("mesh", 0.0)]
    running = executor.submit((stages,), began=lambda worker: told.append(worker), tell=told.append)
    wait_for(lambda: "match" in told)
    assert not running.answer.done() and executor.workers()[0].busy
    assert taken(running).result == "well" and told == [0, "read", "match", "mesh"]
    assert taken(executor.submit((stages[:1],))).result == "well"  # nobody need listen


def test_workers_may_differ(engine, opened):
    executor = opened(worker_tasks.which, workers=2, by_worker=[{"broken": "first"}, {"broken": "second"}])
    jobs = [executor.submit((number,)) for number in range(10)]
    names = ("first", "second")
    assert all(taken(job).result == (number, names[taken(job).worker]) for number, job in enumerate(jobs))


def test_what_fails_says_why_and_takes_nothing_with_it(opened):
    executor = opened(worker_tasks.misbehave)
    refused, fault, well = [taken(executor.submit((way,))) for way in ("refuse", "fault", "well")]
    assert isinstance(refused.error, InputError) and str(refused.error) == "the pair is bad"
    assert isinstance(fault.error, StageError) and "ZeroDivisionError: a fault" in str(fault.error)
    assert "worker_tasks.py" in fault.error.__notes__[0]
    assert refused.result is None and fault.result is None and well.result == "well" and well.error is None


def test_one_that_takes_too_long_is_stopped(opened):
    executor = opened(worker_tasks.take_time, tells=True)
    long = executor.submit((2 * SOON_S,), limits=Limits(seconds=0.2))
    short = executor.submit((0.1,), limits=Limits(seconds=SOON_S))
    assert isinstance(taken(long).error, WorkerError) and "took over 0.2 s" in str(taken(long).error)
    assert taken(short).result == "well"


@pytest.mark.skipif(not MEMORY_IS_KNOWN, reason="this system does not tell what a process holds")
def test_one_that_takes_too_much_memory_is_stopped(engine, opened):
    before = resident_memory() if engine == "inline" else 200 * MEGABYTE
    executor = opened(worker_tasks.grow, tells=True)
    limits = Limits(memory_bytes=before + 100 * MEGABYTE)
    large, small = executor.submit((1500,), limits=limits), executor.submit((20,), limits=limits)
    assert isinstance(taken(large).error, WorkerError) and "MB, over its limit of" in str(taken(large).error)
    assert taken(small).result == 1


def test_what_is_cancelled_stops_and_what_waits_never_begins(opened, tmp_path):
    executor = opened(worker_tasks.take_time, tells=True)
    begun = []
    first = executor.submit((30.0, tmp_path / "first"))
    second = executor.submit((0.0, tmp_path / "second"), began=begun.append)
    third = executor.submit((0.0, tmp_path / "third"))
    wait_for((tmp_path / "first").exists)
    second.cancel()
    assert isinstance(second.answer.result(0).error, CancelledError)
    first.cancel()
    assert isinstance(taken(first).error, CancelledError) and taken(first).result is None
    assert taken(third).result == "well"
    third.cancel()
    assert taken(third).result == "well" and not begun and not (tmp_path / "second").exists()


def test_cancelling_at_any_moment_stops_that_job_alone(opened):
    executor = opened(worker_tasks.take_time, tells=True)
    executor.start()
    for number in range(8):
        doomed, next_one = executor.submit((0.06,)), executor.submit((0.0,))
        time.sleep(0.014 * number)
        doomed.cancel()
        assert taken(doomed).result == "well" or isinstance(taken(doomed).error, CancelledError)
        assert taken(next_one).result == "well"


def test_closing_answers_all_and_takes_no_more(opened, tmp_path):
    executor = opened(worker_tasks.take_time, tells=True)
    running, waiting = executor.submit((2 * SOON_S, tmp_path / "first")), executor.submit((0.0,))
    wait_for((tmp_path / "first").exists)
    executor.close(0.5)
    assert all(isinstance(job.answer.result(0).error, CancelledError) for job in (running, waiting))
    with pytest.raises(StereoError, match="open others"):
        executor.submit((0.0,))
    executor.close()
    assert not any(worker.busy for worker in executor.workers())


def test_closing_amid_what_is_told_cancels_that_job(opened):
    executor = opened(worker_tasks.go_through, tells=True)
    running = executor.submit(([("read", 0.0), ("match", 0.1), ("mesh", 0.0)],), tell=lambda _: executor.close(0.0))
    assert isinstance(taken(running).error, CancelledError)


def test_a_listener_that_fails_costs_no_answer(opened, caplog):
    executor = opened(worker_tasks.take_time, tells=True)

    def fail(_):
        raise ValueError("a bad listener")

    running = executor.submit((0.04,), began=fail, tell=fail)
    assert taken(running).result == "well"
    assert "could not be told" in caplog.text and "a bad listener" in caplog.text
    assert not running.answer.cancel()


def test_one_that_cannot_get_ready_says_so(opened):
    executor = opened(worker_tasks.which, prepare=worker_tasks.refuse_to_prepare, shared={"broken": True})
    executor.start()
    for answer in [taken(executor.submit((number,))) for number in range(2)]:
        assert isinstance(answer.error, WorkerError) and "RuntimeError: no device is left" in str(answer.error)
        assert "\n" not in str(answer.error) and answer.worker is None
    assert not any(worker.warm for worker in executor.workers())


def test_one_that_gives_up_while_it_gets_ready_says_so(opened):
    answer = taken(opened(worker_tasks.double, prepare=sys.exit).submit((1,)))
    assert isinstance(answer.error, WorkerError) and answer.worker is None


def test_what_a_task_s_threads_tell_late_reaches_no_other_job(opened):
    executor = opened(worker_tasks.tell_late, tells=True)
    told = []
    assert taken(executor.submit((0.05,))).result == "well"
    time.sleep(0.1)
    assert taken(executor.submit((0.0,), tell=told.append)).result == "well"
    assert not told


def test_many_threads_may_submit(opened):
    executor = opened(worker_tasks.double, workers=2)
    answers = {}

    def work(first):
        for value in range(first, first + 10):
            answers[value] = taken(executor.submit((value,))).result

    threads = [threading.Thread(target=work, args=(100 * number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert answers == {value: 2 * value for first in range(0, 800, 100) for value in range(first, first + 10)}


def test_a_failed_job_lets_go_of_its_arrays(opened):
    executor = opened(worker_tasks.hold_and_refuse)
    answer = taken(executor.submit((1 << 20,)))
    assert isinstance(answer.error, InputError)
    frames = [frame for frame, _ in traceback.walk_tb(answer.error.__traceback__)]
    assert not any("held" in frame.f_locals for frame in frames)


@pytest.fixture
def processes(engine):
    """The engines whose workers are processes of their own."""
    if engine == "inline":
        pytest.skip("engine inline works in this process")


@pytest.mark.usefixtures("processes")
def test_a_worker_that_dies_loses_its_job_alone(opened):
    executor = opened(worker_tasks.misbehave)
    executor.start()
    said = {way: taken(executor.submit((way,))) for way in ("kill", "crash", "leave")}
    assert all(isinstance(answer.error, WorkerError) for answer in said.values())
    assert "killed, as where memory runs out" in str(said["kill"].error)
    assert "signal SIGABRT" in str(said["crash"].error) and "exit status 3" in str(said["leave"].error)
    hung = executor.submit(("hang",), limits=Limits(seconds=0.3))
    assert "took over 0.3 s" in str(taken(hung).error)
    hung = executor.submit(("hang",))
    wait_for(lambda: executor.workers()[0].busy)
    hung.cancel()
    assert isinstance(taken(hung).error, CancelledError)
    assert taken(executor.submit(("well",))).result == "well"
    wait_for(lambda: executor.workers()[0].warm)


@pytest.mark.usefixtures("processes")
@pytest.mark.skipif(not MEMORY_IS_KNOWN, reason="this system does not tell what a process holds")
def test_memory_counts_what_a_job_starts(opened):
    executor = opened(worker_tasks.grow_in_a_child)
    answer = taken(executor.submit((300,), limits=Limits(memory_bytes=300 * MEGABYTE, seconds=SOON_S)))
    assert isinstance(answer.error, WorkerError) and "over its limit of 300 MB" in str(answer.error)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("cloud", {}, "engine 'cloud': give inline, local or ray"),
        ("local", {"address": "head:6379"}, "address 'head:6379' is of a Ray cluster, engine local works here"),
        ("inline", {"workers": 4}, "workers = 4: engine inline has one"),
        ("local", {"workers": 0}, "workers = 0: give a number of processes"),
    ],
)
def test_a_wrong_engine_is_refused_in_one_line(name, options, message):
    with pytest.raises(InputError, match=message) as refused:
        open_executor(name, Work(task=worker_tasks.double), **options)
    assert "\n" not in str(refused.value)
