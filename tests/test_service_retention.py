import os

import pytest
from stores import Clock, open_store, put

from stereo_gpu.service.data.folders import Folders
from stereo_gpu.service.data.retention import DAY_S, GIGABYTE, sweep
from stereo_gpu.service.records import State
from stereo_gpu.service.settings import Settings
from stereo_gpu.service.store import Ending


@pytest.fixture
def clock():
    clock = Clock()
    clock.now = 2e9  # later than every file of today
    return clock


@pytest.fixture
def folders(tmp_path):
    folders = Folders(tmp_path / "data")
    with folders.own():
        yield folders


@pytest.fixture
def store(folders, clock):
    store = open_store(folders.root, "ann", clock=clock)
    yield store
    assert store.check() == []
    store.close()


def end(store, folders, clock, count, size):
    """Jobs with a folder each that end a day after the other."""
    ids = put(store, count=count, created=clock.now)
    for lease in store.lease("o", count, 30):
        folders.inputs(lease.job.id).mkdir(parents=True)
        clock.now += DAY_S
        store.finish([Ending(id=lease.job.id, number=lease.number, state=State.DONE, bytes=size)])
    return ids


def left(store, folders, ids):
    rows = [id for id in ids if store.any_job(id) is not None]
    assert rows == [id for id in ids if folders.job(id).exists()]
    return rows


def test_jobs_go_by_age(store, folders, clock):
    ids = end(store, folders, clock, 5, 1)
    settings = Settings(data=folders.root, keep_days=2.5)
    assert sweep(store, folders, settings, clock=clock) == 2
    assert left(store, folders, ids) == ids[2:]
    assert sweep(store, folders, settings, clock=clock) == 0
    clock.now += 99 * DAY_S
    assert sweep(store, folders, settings, clock=clock) == 3 and left(store, folders, ids) == []


def test_jobs_go_by_room_the_oldest_first(store, folders, clock):
    ids = end(store, folders, clock, 6, GIGABYTE)
    settings = Settings(data=folders.root, keep_gb=2.5)
    assert sweep(store, folders, settings, clock=clock) == 4
    assert left(store, folders, ids) == ids[4:] and store.ended_bytes() == 2 * GIGABYTE


def test_many_jobs_go_at_once(store, folders, clock):
    ids = put(store, count=250)
    for id in ids:
        store.ask_cancel("ann", id)
    clock.now += 99 * DAY_S
    assert sweep(store, folders, Settings(data=folders.root), clock=clock) == 250
    assert sum(store.counts().values()) == 0


def test_what_waits_runs_or_was_restarted_stays(store, folders, clock):
    runs, waits, restarted = put(store, count=3, bytes=GIGABYTE)
    for id in (waits, runs, restarted):
        folders.inputs(id).mkdir(parents=True)
        os.utime(folders.job(id), (1, 1))
    store.ask_cancel("ann", restarted)
    assert [lease.job.id for lease in store.lease("o", 1, 30)] == [runs]
    store.restart("ann", restarted)
    clock.now += 99 * DAY_S
    assert sweep(store, folders, Settings(data=folders.root, keep_gb=0.0), clock=clock) == 0
    assert left(store, folders, [waits, runs, restarted]) == [waits, runs, restarted]


def test_a_job_that_is_restarted_during_the_sweep_stays(store, folders, clock):
    (job,) = put(store)
    folders.inputs(job).mkdir(parents=True)
    store.ask_cancel("ann", job)
    clock.now += 99 * DAY_S
    listed = store.ended_before

    def restart_meanwhile(time, *, limit):
        jobs = listed(time, limit=limit)
        for found in jobs:
            store.restart("ann", found.id)
        return jobs

    store.ended_before = restart_meanwhile
    assert sweep(store, folders, Settings(data=folders.root), clock=clock) == 0
    assert left(store, folders, [job]) == [job]


def test_folders_without_a_row_go_and_pictures_of_known_jobs_stay(store, folders, clock):
    (job,) = put(store)
    for id in (job, "f" * 32):
        folders.inputs(id).mkdir(parents=True)
    assert sweep(store, folders, Settings(data=folders.root), clock=clock) == 0
    assert [part.name for part in folders.jobs.iterdir()] == [job]
