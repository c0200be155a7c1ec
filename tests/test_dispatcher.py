"""Jobs from the table to workers and back: each ends exactly once, whatever dies, fails or is stopped on the way."""

import json
import logging
import threading
import time
from contextlib import contextmanager

import pytest
from conftest import need_service
from stores import new_id, put, rig_of

need_service()

import service_tasks  # noqa: E402

from stereo_gpu.engines.executor import Work  # noqa: E402
from stereo_gpu.engines.inline import InlineExecutor  # noqa: E402
from stereo_gpu.engines.local import LocalExecutor  # noqa: E402
from stereo_gpu.errors import InputError  # noqa: E402
from stereo_gpu.service.data.folders import Folders  # noqa: E402
from stereo_gpu.service.dispatch import dispatcher  # noqa: E402
from stereo_gpu.service.dispatch.dispatcher import Dispatcher  # noqa: E402
from stereo_gpu.service.jobs.outcome import Outcome  # noqa: E402
from stereo_gpu.service.live import Live  # noqa: E402
from stereo_gpu.service.metrics import Metrics  # noqa: E402
from stereo_gpu.service.records import RigRecord, State  # noqa: E402
from stereo_gpu.service.refusals import StoreError  # noqa: E402
from stereo_gpu.service.settings import Settings  # noqa: E402
from stereo_gpu.service.store import Store  # noqa: E402


class Faulty(Store):
    """A store whose disk fails from time to time: after the write as well as before it."""

    def __init__(self, path):
        super().__init__(path)
        self.calls, self.faults = 0, 0

    def _fault(self):
        self.calls += 1
        if self.calls % 3 == 0 and self.faults < 4:
            self.faults += 1
            raise StoreError("the disk hiccupped")

    def finish(self, endings):
        self._fault()
        applied = super().finish(endings)
        self._fault()
        return applied


class Bench:
    """A dispatcher with all that it needs, on a folder."""

    def __init__(self, data, executor=InlineExecutor, store=Store, **settings):
        self.settings = Settings(data=data, **{"spare_gb": 0.0, "lease_seconds": 30.0, **settings})
        self.folders = Folders(data)
        self.store = store(self.folders.database)
        if not self.store.clients():
            self.store.add_client("ann")
            self.store.add_rig(RigRecord(id=rig_of("ann"), client="ann", name="rig", created=1000.0))
        self.work = Work(task=service_tasks.do, shared={"data": data}, tells=True)
        self.executor = executor(self.work)
        self.live = Live()
        self.metrics = Metrics(self.store.counts, self.executor, data)
        self.dispatcher = Dispatcher(self.store, self.folders, self.live, self.executor, self.settings, self.metrics)

    def put(self, count=1, **options):
        ids = put(self.store, count=count, options=options, created=time.time())
        for id in ids:
            self.folders.inputs(id).mkdir(parents=True)
        self.dispatcher.wake()
        return ids

    def job(self, id):
        return self.store.any_job(id)

    def wait(self, ids, seconds=30):
        until = time.monotonic() + seconds
        while not all(self.job(id).state.ended for id in ids):
            assert time.monotonic() < until, [self.job(id) for id in ids]
            time.sleep(0.005)
        return [self.job(id) for id in ids]

    def wait_for(self, true, seconds=30):
        until = time.monotonic() + seconds
        while not true():
            assert time.monotonic() < until
            time.sleep(0.005)

    def begun(self, id):
        """How the rig was to be checked, a line for each try that began."""
        path = self.settings.data / "begun" / id
        return path.read_text().split() if path.exists() else []

    def count(self, name, **labels):
        return self.metrics.registry.get_sample_value(name, labels)


@contextmanager
def bench(data, executor=InlineExecutor, store=Store, **settings):
    with Folders(data).own():
        one = Bench(data, executor, store, **settings)
        one.dispatcher.start()
        try:
            yield one
        finally:
            one.dispatcher.stop(0.0)
            one.executor.close()
            one.store.close()


def two_workers(work):
    return LocalExecutor(work, workers=2)


def test_jobs_end_once_and_their_results_are_whole(tmp_path):
    with bench(tmp_path, two_workers) as one:
        ids = one.put(30)
        for job in one.wait(ids):
            assert (job.state, job.tries, job.error, job.warnings) == (State.DONE, 1, None, ("look",))
            assert job.summary == {"triangles": 3} and set(job.seconds) == {"read", "total"}
            manifest = one.folders.manifest(job.id)
            assert [file.name for file in manifest.files] == ["model.glb", "result.json"]
            assert job.bytes == one.folders.bytes(job.id) > manifest.bytes
            assert one.begun(job.id) in (["full"], ["rows"])
        assert one.store.check() == []
        labels = {"kind": "reconstruction", "state": "done"}
        assert one.count("stereo_gpu_jobs_ended_total", **labels) == 30
        assert one.count("stereo_gpu_device_free_bytes", device="a GPU") == 5
        assert one.live.stages() == {}


def test_a_worker_that_is_killed_loses_its_try_alone(tmp_path):
    with bench(tmp_path, two_workers) as one:
        good = one.put(6)
        [once] = one.put(do=["kill", "nothing"])
        [always] = one.put(do=["kill"])
        more = one.put(6)
        done, failed = one.wait([once, always])
        assert (done.state, done.tries) == (State.DONE, 2)
        assert (failed.state, failed.tries) == (State.FAILED, 3)
        assert "was killed" in failed.error and "tried 3 times" in failed.error and "\n" not in failed.error
        assert {job.state for job in one.wait([*good, *more])} == {State.DONE}
        assert one.count("stereo_gpu_tries_lost_total", reason="worker") == 4
        assert not list(one.folders.job(always).glob("try-*"))
        assert one.store.check() == []


def test_a_bad_pair_fails_at_once_with_its_line_and_a_device_is_tried_again(tmp_path):
    with bench(tmp_path) as one:
        [bad] = one.put(do=["refuse"])
        [empty] = one.put(do=["nothing to do"])
        [device] = one.put(do=["device", "nothing"])
        [torn] = one.put(do=["torn", "nothing"])
        [always] = one.put(do=["torn"])
        jobs = one.wait([bad, empty, device, torn])
        assert [job.state for job in jobs] == [State.FAILED, State.FAILED, State.DONE, State.DONE]
        assert [job.error for job in jobs[:2]] == ["the pair is bad", "nothing was left"]
        assert [job.tries for job in jobs] == [1, 1, 2, 2]
        assert one.count("stereo_gpu_tries_lost_total", reason="device") == 1
        [failed] = one.wait([always])
        assert failed.error.startswith("its result could not be kept whole") and str(tmp_path) not in failed.error
        assert one.count("stereo_gpu_tries_lost_total", reason="result") == 4


def test_a_job_that_is_cancelled_ends_so_wherever_it_is(tmp_path):
    with bench(tmp_path) as one:
        [slow] = one.put(do=["slow"])
        waiting, queued = one.put(2, do=["nothing"])
        one.wait_for((tmp_path / "slow").exists)
        assert one.live.progress(slow).stage in ("read", "match")
        for id in (waiting, queued, slow):
            one.store.ask_cancel("ann", id)
            one.dispatcher.cancel(id)
        assert [job.state for job in one.wait([slow, waiting, queued])] == [State.CANCELLED] * 3
        assert one.begun(waiting) == one.begun(queued) == []
        assert one.job(slow).error is None and not list(one.folders.job(slow).glob("try-*"))
        [after] = one.put()
        assert one.wait([after])[0].state is State.DONE


def test_a_cancel_that_only_the_table_knows_is_found_by_the_heartbeat(tmp_path):
    with bench(tmp_path, lease_seconds=0.3) as one:
        [slow] = one.put(do=["slow"])
        one.wait_for((tmp_path / "slow").exists)
        one.store.ask_cancel("ann", slow)
        assert one.wait([slow])[0].state is State.CANCELLED


def test_a_heartbeat_keeps_a_job_that_takes_longer_than_its_lease(tmp_path):
    with bench(tmp_path, lease_seconds=0.2) as one:
        [slow] = one.put(do=["slow"])
        one.wait_for((tmp_path / "slow").exists)
        one.wait_for(lambda: one.job(slow).stage == "match")
        time.sleep(0.6)
        assert (one.job(slow).state, one.job(slow).tries) == (State.RUNNING, 1)
        assert 0 < one.job(slow).fraction < 1


def test_a_stop_gives_back_what_is_not_done_and_the_next_start_does_it(tmp_path):
    with bench(tmp_path) as one:
        [slow] = one.put(do=["slow", "nothing"])
        rest = one.put(3)
        one.wait_for((tmp_path / "slow").exists)
        one.dispatcher.stop(0.05)
        assert not one.dispatcher.alive
        for id in (slow, *rest):
            assert (one.job(id).state, one.job(id).tries) == (State.QUEUED, 0)
        assert not list(one.folders.job(slow).glob("try-*"))
    with bench(tmp_path) as one:
        assert {(job.state, job.tries) for job in one.wait([slow, *rest])} == {(State.DONE, 1)}
        assert one.store.check() == []


def test_a_stop_does_not_charge_what_no_worker_lets_go_of(tmp_path, monkeypatch):
    monkeypatch.setattr(dispatcher, "LATE_S", 0.1)
    go_on = threading.Event()
    deaf = Work(task=lambda *_, **__: go_on.wait(60), tells=True)  # it tells no stage, where it could be stopped
    with bench(tmp_path, lambda _: InlineExecutor(deaf)) as one:
        [id] = one.put()
        one.wait_for(lambda: one.job(id).state is State.RUNNING)
        one.dispatcher.stop(0.05)
        assert (one.job(id).state, one.job(id).tries) == (State.QUEUED, 0)
        go_on.set()


def test_a_stop_lets_what_has_begun_end_within_its_grace(tmp_path):
    with bench(tmp_path, two_workers) as one:
        ids = one.put(12)
        one.wait_for(lambda: any(one.begun(id) for id in ids))
        one.dispatcher.stop(20.0)
        jobs = [one.job(id) for id in ids]
        assert {job.state for job in jobs} <= {State.DONE, State.QUEUED}
        for job in jobs:
            assert (job.state is State.DONE) == bool(one.begun(job.id))


def test_a_result_that_is_whole_is_not_made_again(tmp_path):
    with bench(tmp_path) as one:
        one.dispatcher.stop(0.0)
        [id] = one.put()
        [lease] = one.store.lease("a service that dies", 1, 30.0)
        attempt = one.folders.attempt(id, lease.number)
        attempt.mkdir()
        (attempt / "model.glb").write_bytes(b"model")
        outcome = Outcome(summary={"triangles": 8}, warnings=("so",), seconds={"read": 2.0})
        (attempt / "result.json").write_text(json.dumps(outcome.as_json()))
        one.folders.seal(attempt)
        one.folders.publish(id, lease.number)
    with bench(tmp_path) as one:
        [job] = one.wait([id])
        assert (job.state, job.summary, job.warnings) == (State.DONE, {"triangles": 8}, ("so",))
        assert job.seconds == {"read": 2.0, "total": 2.0}
        assert one.begun(id) == []
        assert (one.folders.result(id) / "model.glb").read_bytes() == b"model"


def test_a_disk_that_fails_from_time_to_time_loses_and_doubles_nothing(tmp_path, caplog):
    with caplog.at_level(logging.CRITICAL, "stereo_gpu.service"), bench(tmp_path, store=Faulty) as one:
        ids = one.put(8)
        assert {job.state for job in one.wait(ids)} == {State.DONE}
        assert one.store.faults >= 2
        assert all(len(one.begun(id)) == 1 for id in ids)
        assert one.dispatcher.alive and one.store.check() == []


def test_an_ending_that_no_table_can_hold_holds_up_no_other(tmp_path):
    with bench(tmp_path) as one:
        [odd] = one.put(do=["odd"])
        good = one.put(5)
        assert {job.state for job in one.wait(good)} == {State.DONE}
        [job] = one.wait([odd])
        assert job.state is State.FAILED and "cannot be kept" in job.error


def test_jobs_wait_uncharged_where_no_worker_can_be_had(tmp_path):
    def broken(work):
        return InlineExecutor(
            Work(task=work.task, shared=work.shared, tells=True, prepare=service_tasks.refuse_to_begin)
        )

    with bench(tmp_path, broken) as one:
        ids = one.put(3)
        time.sleep(1.5)
        one.dispatcher.stop(0.0)
        assert {(one.job(id).state, one.job(id).tries) for id in ids} == {(State.QUEUED, 0)}


def test_a_job_waits_until_a_worker_has_it(tmp_path):
    with bench(tmp_path, two_workers) as one:
        slow = one.put(2, do=["slow"])
        one.wait_for(lambda: all(one.job(id).state is State.RUNNING for id in slow))
        ahead = one.put(2)
        one.wait_for(lambda: all(one.live.progress(id) is not None for id in ahead))  # leased
        assert {(one.job(id).state, one.job(id).tries, one.job(id).started) for id in ahead} == {
            (State.QUEUED, 0, None)
        }
        assert one.store.places([one.job(id) for id in ahead]) == {ahead[0]: 0, ahead[1]: 1}
        one.store.ask_cancel("ann", ahead[0])
        one.dispatcher.cancel(ahead[0])
        assert one.job(ahead[0]).state is State.CANCELLED
        one.store.restart("ann", ahead[0])  # while the dispatcher has it still
        one.dispatcher.wake()
        for id in slow:
            one.store.ask_cancel("ann", id)
            one.dispatcher.cancel(id)
        assert {(job.state, job.tries) for job in one.wait(ahead)} == {(State.DONE, 1)}
        assert one.store.check() == []


def test_a_try_counts_before_the_inline_engine_begins_it(tmp_path):
    # A pair that crashes it crashes the service: the table must know by then, or it would be the next one for ever.
    seen = []

    def look(order, *, tell):
        seen.append(one.job(order.job))
        raise InputError("seen")

    with bench(tmp_path, lambda work: InlineExecutor(Work(task=look, tells=True))) as one:
        one.wait(one.put())
        assert [(job.state, job.tries) for job in seen] == [(State.RUNNING, 1)]


def test_a_rig_is_checked_in_full_until_a_pair_was_right(tmp_path):
    with bench(tmp_path) as one:
        [first] = one.put()
        one.wait([first])
        [second] = one.put()
        [asked] = one.put(check="full")
        [never] = one.put(check="never")
        one.wait([second, asked, never])
        assert [one.begun(id) for id in (first, second, asked, never)] == [["full"], ["rows"], ["full"], ["never"]]


def test_a_job_that_was_taken_away_meanwhile_ends_by_its_last_lease_alone(tmp_path):
    with bench(tmp_path, two_workers, lease_seconds=60.0) as one:
        [id] = one.put(do=["slow", "nothing"])
        one.wait_for(lambda: (tmp_path / "slow").exists() and one.job(id).state is State.RUNNING)
        [job] = one.store.reclaim(lambda owner: False, 3)
        assert (job.id, job.state) == (id, State.QUEUED)
        one.dispatcher.wake()
        [job] = one.wait([id])
        assert (job.state, job.tries) == (State.DONE, 2)
        one.wait_for(lambda: not any(worker.busy for worker in one.executor.workers()))
        assert one.folders.manifest(id) is not None and one.store.check() == []


def test_sixteen_who_post_and_cancel_see_each_job_end_once(tmp_path):
    with bench(tmp_path) as one:
        ids, lock = [], threading.Lock()

        def post(number):
            for turn in range(5):
                [id] = one.put()
                with lock:
                    ids.append(id)
                if (number + turn) % 3 == 0 and not one.job(id).state.ended:
                    try:
                        one.store.ask_cancel("ann", id)
                    except Exception:
                        continue  # it has ended
                    one.dispatcher.cancel(id)

        threads = [threading.Thread(target=post, args=(number,)) for number in range(16)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        jobs = one.wait(ids)
        assert len({job.id for job in jobs}) == 80 and {job.state for job in jobs} <= {State.DONE, State.CANCELLED}
        for job in jobs:
            assert (job.state is State.DONE) == (one.folders.manifest(job.id) is not None)
            assert len(one.begun(job.id)) <= 1
        assert one.store.check() == []


def test_a_job_whose_rig_is_gone_says_so(tmp_path):
    with bench(tmp_path) as one:
        one.dispatcher.stop(0.0)
        [id] = one.put()
        with one.store._database.write() as tables:
            tables.execute("DELETE FROM rigs")
    with bench(tmp_path) as one:
        [job] = one.wait([id])
        assert job.state is State.FAILED and job.error.startswith(f"its rig {rig_of('ann')} is there no more")


@pytest.mark.parametrize("id", [new_id()])
def test_to_cancel_what_is_not_under_way_does_nothing(tmp_path, id):
    with bench(tmp_path) as one:
        one.dispatcher.cancel(id)
        [job] = one.put()
        assert one.wait([job])[0].state is State.DONE
