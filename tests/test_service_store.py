import os
import sqlite3
import threading
from dataclasses import replace

import pytest
from stores import NO_LIMITS, Clock, new_id, new_job, open_store, put, rig_of

from stereo_gpu.errors import InputError
from stereo_gpu.service.records import Kind, RigRecord, State
from stereo_gpu.service.refusals import Busy, Conflict, DiskFull, KeyReused, NotFound, QueueFull, StoreError
from stereo_gpu.service.store import Ending, Store


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def store(tmp_path, clock):
    store = open_store(tmp_path, "ann", "bob", clock=clock)
    yield store
    assert store.check() == []
    store.close()


def finish(store, lease, state=State.DONE, **given):
    return store.finish([Ending(id=lease.job.id, number=lease.number, state=state, **given)])


# -- clients


def test_a_token_is_its_clients_and_only_its_hash_is_kept(store, tmp_path):
    token, other = store.add_client("cup.shop_1"), store.add_client("cup.shop_1")
    assert len(token) == 43 and token != other
    assert store.client_of(token) == store.client_of(other) == "cup.shop_1"
    for wrong in ("", token[:-1], token + "A", token.swapcase(), "x" * 10_000, "\udcff\x00"):
        assert store.client_of(wrong) is None
    assert store.clients() == ["ann", "bob", "cup.shop_1"]
    held = b"".join(path.read_bytes() for path in tmp_path.iterdir())
    assert token.encode() not in held and b"cup.shop_1" in held
    assert store.remove_client("cup.shop_1") and not store.remove_client("cup.shop_1")
    assert store.client_of(token) is None and store.clients() == ["ann", "bob"]


@pytest.mark.parametrize("name", ["", "a b", "../x", "-x", "x" * 65, "ü", "a\n"])
def test_odd_names_of_clients_are_refused(store, name):
    with pytest.raises(InputError, match="up to 64 letters"):
        store.add_client(name)


# -- rigs


def test_a_rig_comes_back_as_it_went_in_and_is_its_clients_alone(store):
    rig = RigRecord(id=new_id(), client="ann", name="rïg", created=5.0, summary={"width": 4, "rms_px": None})
    kept = store.add_rig(rig)
    assert kept == replace(rig, order=kept.order) == store.rig("ann", rig.id)
    assert store.rig("bob", rig.id) is None and store.rig("ann", "x") is None
    assert not store.delete_rig("bob", rig.id) and store.rig("ann", rig.id)
    assert store.delete_rig("ann", rig.id) and not store.delete_rig("ann", rig.id)


def test_rigs_are_listed_by_pages_newest_first(store):
    made = [store.add_rig(RigRecord(id=new_id(), client="ann", name=str(n), created=5.0)) for n in range(5)]
    first = store.rigs("ann", limit=3)
    rest = store.rigs("ann", limit=9, after=first[-1].order)
    assert [rig.id for rig in first + rest] == [rig.id for rig in made[::-1]] + [rig_of("ann")]
    assert [rig.client for rig in store.rigs("bob")] == ["bob"]


def test_a_rig_stays_while_a_job_needs_it(store):
    (job,) = put(store)
    with pytest.raises(Busy, match=r"needed by 1 jobs.*: cancel them"):
        store.delete_rig("ann", rig_of("ann"))
    store.ask_cancel("ann", job)
    assert store.delete_rig("ann", rig_of("ann"))
    assert store.job("ann", job).rig == rig_of("ann")
    with pytest.raises(Conflict, match="has been deleted"):
        store.restart("ann", job)
    with pytest.raises(InputError, match="there is no rig"):
        put(store)


# -- the queue


def test_a_job_comes_back_as_it_went_in(store):
    job = new_job(label="c\udcffup ☕", options={"profile": "fast", "disparities": [40, 64]}, pixels=12, bytes=99)
    kept, new = store.enqueue(job, key=None, fingerprint="", **NO_LIMITS)
    assert new and kept == replace(job, label="c?up ☕", order=kept.order) == store.job("ann", job.id)
    assert store.any_job(job.id) == kept and store.any_job(new_id()) is None
    with pytest.raises(NotFound, match="no job"):
        store.job("bob", job.id)


def test_a_key_makes_a_retry_safe(store):
    first, again, other = new_job(), new_job(), new_job("bob")
    assert store.enqueue(first, key="k", fingerprint="f", **NO_LIMITS)[1]
    kept, new = store.enqueue(again, key="k", fingerprint="f", queue_limit=0, client_limit=0)
    assert (kept.id, new) == (first.id, False) and store.any_job(again.id) is None
    with pytest.raises(KeyReused, match=f"belongs to job {first.id}"):
        store.enqueue(again, key="k", fingerprint="g", **NO_LIMITS)
    assert store.enqueue(other, key="k", fingerprint="g", **NO_LIMITS)[1]
    store.ask_cancel("ann", first.id)
    store.delete("ann", first.id)
    assert store.enqueue(again, key="k", fingerprint="g", **NO_LIMITS)[1]


def test_a_full_queue_says_when_to_come_back(store, clock):
    put(store, "ann", 2)
    put(store, "bob", 1)
    with pytest.raises(QueueFull, match="2 jobs of yours wait, the limit is 2") as own:
        store.enqueue(new_job(), key=None, fingerprint="", queue_limit=9, client_limit=2)
    with pytest.raises(QueueFull, match="3 jobs wait, the limit is 3"):
        store.enqueue(new_job(), key=None, fingerprint="", queue_limit=3, client_limit=9)
    assert own.value.retry_s == 60  # nothing has ended yet
    for job in put(store, count=240):
        store.ask_cancel("ann", job)
    with pytest.raises(QueueFull) as after:
        store.enqueue(new_job(), key=None, fingerprint="", queue_limit=3, client_limit=9)
    assert after.value.retry_s == 2  # room for eight, at four a second
    clock.now += 61
    with pytest.raises(QueueFull) as later:
        store.restart("ann", job, queue_limit=3)
    assert later.value.retry_s == 60


def test_jobs_are_listed_by_pages_newest_first(store):
    ids = put(store, count=5) + put(store, kind=Kind.CALIBRATION, rig=None)
    put(store, "bob")
    store.ask_cancel("ann", ids[1])
    first = store.jobs("ann", limit=4)
    assert [job.id for job in first + store.jobs("ann", after=first[-1].order)] == ids[::-1]
    assert [job.id for job in store.jobs("ann", state=State.CANCELLED)] == [ids[1]]
    assert [job.id for job in store.jobs("ann", kind=Kind.CALIBRATION, state=State.QUEUED)] == [ids[5]]
    assert store.jobs("ann", state=State.DONE) == []
    assert store.counts()[State.QUEUED] == 6 and store.counts()[State.CANCELLED] == 1


def test_a_place_counts_those_that_come_before(store):
    for _ in range(3):  # each time somebody else had the last turn
        jobs = [store.any_job(job) for job in put(store, "ann", 5) + put(store, "bob", 2)]
        places = store.places(jobs)
        order = []
        while leases := store.lease("o", 1, 30):
            order.append(leases[0].job.id)
            finish(store, leases[0])
        assert places == {job: place for place, job in enumerate(order)}
    assert store.places([store.any_job(order[0])]) == {}


def test_a_place_counts_those_that_are_leased_and_have_not_begun(store):
    ids = put(store, "ann", 4)
    (own,) = put(store, "bob")
    leases = store.lease("o", 3, 30)  # ann's, bob's, ann's
    places = store.places([store.any_job(job) for job in (*ids, own)])
    assert places == {ids[0]: 0, ids[1]: 1, own: 2, ids[2]: 3, ids[3]: 4}
    store.begin(leases[:1])
    assert store.places([store.any_job(job) for job in (ids[0], ids[3])]) == {ids[3]: 3}


# -- cancel, restart, delete


def test_cancel(store, clock):
    waits, runs, done = put(store, count=3)
    assert store.ask_cancel("ann", waits).state is State.CANCELLED
    assert store.ask_cancel("ann", waits).ended == clock.now  # once more is no error
    lease, other = store.lease("o", 2, 30)
    store.begin([lease, other])
    finish(store, other)
    asked = store.ask_cancel("ann", runs)
    assert asked.state is State.RUNNING and asked.cancel_asked
    assert store.beat("o", {runs: ("match", 0.5)}, 30) == {runs}
    assert finish(store, lease, State.CANCELLED) == {runs}
    assert store.job("ann", runs).state is State.CANCELLED
    with pytest.raises(Conflict, match="is done"):
        store.ask_cancel("ann", done)
    with pytest.raises(NotFound):
        store.ask_cancel("bob", waits)


def test_restart_begins_anew_and_never_gives_a_number_twice(store):
    (job,) = put(store)
    with pytest.raises(Conflict, match="is queued"):
        store.restart("ann", job)
    (lease,) = store.lease("o", 1, 30)
    finish(store, lease, State.FAILED, error="no surface", seconds={"total": 1.0})
    again = store.restart("ann", job)
    assert (again.state, again.tries, again.error, again.ended, again.seconds) == (State.QUEUED, 0, None, None, {})
    (second,) = store.lease("o", 1, 30)
    assert (second.job.tries, second.number) == (0, 2)
    finish(store, second)
    with pytest.raises(Conflict, match="is done"):
        store.restart("ann", job)


def test_delete_takes_only_what_has_ended(store):
    runs, leased, waits = put(store, count=3)
    store.begin(store.lease("o", 2, 30)[:1])
    for job in (runs, leased, waits):
        with pytest.raises(Conflict, match="cancel it first"):
            store.delete("ann", job)
        store.ask_cancel("ann", job)
    with pytest.raises(Conflict, match="is running"):
        store.delete("ann", runs)
    with pytest.raises(NotFound):
        store.delete("bob", waits)
    store.delete("ann", waits)
    with pytest.raises(NotFound):
        store.job("ann", waits)


# -- the file


def test_the_file_is_its_owners_alone(store, tmp_path):
    modes = {path.name: path.stat().st_mode & 0o777 for path in tmp_path.iterdir()}
    assert set(modes.values()) == {0o600}, modes


def test_every_write_reaches_the_disk(store):
    settings = {"journal_mode": "wal", "synchronous": 2, "foreign_keys": 1}  # 2 is FULL
    with store._database.write() as tables:
        assert {name: tables.execute(f"PRAGMA {name}").fetchone()[0] for name in settings} == settings


def test_what_is_written_is_there_after_opening_again(tmp_path):
    store = open_store(tmp_path, "ann")
    token, (job,) = store.add_client("bob"), put(store)
    store.close()
    store.close()
    with pytest.raises(StoreError, match="is closed"):
        store.counts()
    again = Store(tmp_path / "service.sqlite3", create=False)
    assert again.client_of(token) == "bob" and again.job("ann", job).state is State.QUEUED
    again.close()


def test_another_process_may_write_beside_us(store, tmp_path):
    beside = Store(tmp_path / "service.sqlite3", create=False)
    token = beside.add_client("eve")
    assert store.client_of(token) == "eve"
    beside.close()


def test_damage_is_told_in_one_line(tmp_path):
    path = tmp_path / "service.sqlite3"
    store = open_store(tmp_path, "ann")
    put(store, count=200)
    store.close()
    whole = path.read_bytes()
    for damaged in (
        b"no database, but text " * 300,
        whole[:5000] + os.urandom(60_000) + whole[65_000:],
        whole[: len(whole) // 2],
    ):
        path.write_bytes(damaged)
        with pytest.raises(StoreError, match=r"service\.sqlite3 is damaged.*from a backup$") as told:
            Store(path)
        assert "\n" not in str(told.value)
        assert path.read_bytes() == damaged


def test_databases_of_others_are_left_alone(tmp_path):
    path = tmp_path / "other.sqlite3"
    other = sqlite3.connect(path)
    other.execute("CREATE TABLE shop (item)")
    other.commit()
    other.close()
    before = path.read_bytes()
    with pytest.raises(InputError, match="another program"):
        Store(path)
    assert path.read_bytes() == before
    with pytest.raises(InputError, match="missing"):
        Store(tmp_path / "none.sqlite3", create=False)
    with pytest.raises(InputError, match="cannot write"):
        Store(tmp_path / "none" / "x.sqlite3")


def test_a_newer_version_is_refused(tmp_path):
    open_store(tmp_path).close()
    newer = sqlite3.connect(tmp_path / "service.sqlite3")
    newer.execute("PRAGMA user_version = 99")
    newer.close()
    with pytest.raises(InputError, match="version 99, this package knows"):
        Store(tmp_path / "service.sqlite3")


def test_a_full_disk_takes_nothing_and_breaks_nothing(store):
    put(store)
    store._database._writer.execute("PRAGMA max_page_count = 30")
    with pytest.raises(DiskFull, match="the disk is full; make room"):
        put(store, count=1000, label="x" * 1000)
    held = store.counts()[State.QUEUED]
    assert 0 < held < 1000
    with pytest.raises(DiskFull):
        put(store, label="x" * 5000)
    assert store.counts()[State.QUEUED] == held and store.check() == []
    (lease,) = store.lease("o", 1, 30)
    assert finish(store, lease) == {lease.job.id}
    store._database._writer.execute("PRAGMA max_page_count = 100000")
    put(store, label="x" * 5000)
    assert store.counts()[State.QUEUED] == held


def test_what_no_rule_allows_is_found_by_the_check(tmp_path):
    store = open_store(tmp_path, "ann")
    (job,) = put(store)
    other = sqlite3.connect(tmp_path / "service.sqlite3")
    other.execute("DELETE FROM rigs")
    other.execute("PRAGMA ignore_check_constraints = 1")
    other.execute("UPDATE jobs SET state = 'done'")
    other.commit()
    other.close()
    found = store.check()
    assert f"job {job} waits for a rig that is not there" in found
    assert any("CHECK constraint failed in jobs" in line for line in found)
    store.close()


def test_nothing_that_is_asked_often_reads_the_whole_table(store):
    put(store, count=3)
    asked = []
    for tables in (store._database._reader, store._database._writer):
        tables.set_trace_callback(asked.append)
    job, *_ = store.jobs("ann")
    for kind in (None, Kind.CALIBRATION):
        for state in (None, State.FAILED):
            store.jobs("ann", kind=kind, state=state, after=10**6)
    store.counts(), store.places([job]), store.any_job(job.id), store.known(), store.leased()
    store.ended_bytes(), store.ended_before(1.0), store.delete_rig("ann", new_id())
    put(store)
    leases = store.lease("o", 2, 30)
    store.begin(leases)
    store.beat("o", {lease.job.id: ("match", 0.5) for lease in leases}, 30)
    finish(store, leases[0])
    store.give_back("o", [leases[1].job.id], charge=True)
    store.reclaim(None, 3)
    for tables in (store._database._reader, store._database._writer):
        tables.set_trace_callback(None)
    plans = {}
    for query in asked:
        if query.startswith(("SELECT", "UPDATE")):
            plan = store._database._reader.execute(f"EXPLAIN QUERY PLAN {query}")
            plans[query] = [row["detail"] for row in plan if row["detail"].startswith("SCAN jobs")]
    # An index alone is small, and that of what is leased has a few rows.
    reads = {
        query: plan for query, plan in plans.items() if not all("COVERING" in s or "jobs_leased" in s for s in plan)
    }
    assert len(plans) > 20 and reads == {}


def test_sixteen_threads_lose_and_double_nothing(tmp_path):
    clients = [f"client{n}" for n in range(4)]
    store = open_store(tmp_path, *clients)
    new, ended, errors = [], [], []
    posted = threading.Event()

    def post(number):
        # Four threads a client send the same twelve requests.
        client = clients[number % 4]
        for key in range(12):
            kept, fresh = store.enqueue(new_job(client), key=str(key), fingerprint="f", **NO_LIMITS)
            if fresh:
                new.append(kept.id)
            store.places([kept])
            store.jobs(client, limit=3)

    def work(number):
        while True:
            over = posted.is_set()
            leases = store.lease(f"worker{number}", 3, 30)
            store.beat(f"worker{number}", {lease.job.id: ("match", 0.5) for lease in leases}, 30)
            endings = [Ending(id=lease.job.id, number=lease.number, state=State.DONE) for lease in leases]
            ended.extend(store.finish(endings))
            if over and not leases:
                return

    def guarded(task, number):
        try:
            task(number)
        except BaseException as error:
            errors.append(error)

    posters = [threading.Thread(target=guarded, args=(post, n)) for n in range(16)]
    workers = [threading.Thread(target=guarded, args=(work, n)) for n in range(4)]
    for thread in posters + workers:
        thread.start()
    for thread in posters:
        thread.join()
    posted.set()
    for thread in workers:
        thread.join()
    assert errors == []
    assert len(new) == len(set(new)) == 48 and sorted(ended) == sorted(new)
    assert store.counts()[State.DONE] == 48 and store.check() == []
    store.close()
