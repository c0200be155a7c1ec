"""The service without HTTP: opened on a folder, closed in order, refused in one line."""

import errno
import stat
import time

import pytest
from conftest import need_service

need_service()

from stereo_gpu.errors import BackendError, InputError  # noqa: E402
from stereo_gpu.service.data import housekeeping  # noqa: E402
from stereo_gpu.service.data.folders import Folders  # noqa: E402
from stereo_gpu.service.dispatch import workers  # noqa: E402
from stereo_gpu.service.records import Job, Kind, State  # noqa: E402
from stereo_gpu.service.refusals import DiskFull  # noqa: E402
from stereo_gpu.service.service import FIRST_CLIENT, Service  # noqa: E402
from stereo_gpu.service.settings import Settings  # noqa: E402
from stereo_gpu.service.store import Store  # noqa: E402


def settings(tmp_path, **given):
    return Settings(data=tmp_path / "data", **{"engine": "inline", "spare_gb": 0.0, **given})


def test_the_first_start_makes_a_token_and_later_ones_keep_it(tmp_path):
    one = Service.open(settings(tmp_path))
    try:
        token = one.new_token
        assert one.folders.token_file.read_text().strip() == token
        assert stat.S_IMODE(one.folders.token_file.stat().st_mode) == 0o600
        assert one.store.client_of(token) == FIRST_CLIENT
        with pytest.raises(InputError, match="serves"):
            Service.open(settings(tmp_path))
    finally:
        one.close(0.0)
    again = Service.open(settings(tmp_path))
    try:
        assert again.new_token is None and again.store.client_of(token) == FIRST_CLIENT
    finally:
        again.close(0.0)
    assert not again.dispatcher.alive


@pytest.mark.parametrize(
    "wrong, error, line",
    [
        ({"backend": "abacus"}, BackendError, "abacus"),
        ({"engine": "steam"}, InputError, "engine 'steam'"),
        ({"engine": "local", "workers": 0}, InputError, "workers = 0"),
    ],
)
def test_what_cannot_be_is_refused_in_a_line_and_leaves_the_folder_free(tmp_path, wrong, error, line):
    with pytest.raises(error, match=line) as caught:
        Service.open(settings(tmp_path, **wrong))
    assert "\n" not in str(caught.value)
    Service.open(settings(tmp_path)).close(0.0)


def test_it_says_why_it_is_not_ready(tmp_path):
    one = Service.open(settings(tmp_path, spare_gb=10.0**6))
    try:
        assert "less than 1e+06 GB is free on the disk" in one.not_ready()
        until = time.monotonic() + 60
        while "no worker is warm yet" in one.not_ready():
            assert time.monotonic() < until
            time.sleep(0.02)
        assert len(one.not_ready()) == 1
    finally:
        one.close(0.0)
    assert "it is stopping" in one.not_ready()


def test_a_token_that_cannot_be_kept_does_not_count(tmp_path, monkeypatch):
    def full(*_):
        raise DiskFull("cannot write token: the disk is full; make room")

    with monkeypatch.context() as patched:
        patched.setattr(Folders, "keep_token", full)
        with pytest.raises(DiskFull, match="make room"):
            Service.open(settings(tmp_path))
    one = Service.open(settings(tmp_path))
    try:
        assert one.store.client_of(one.folders.token_file.read_text().strip()) == FIRST_CLIENT
    finally:
        one.close(0.0)


def test_a_folder_that_cannot_be_reached_is_a_reason_not_a_fault(tmp_path, monkeypatch):
    one = Service.open(settings(tmp_path))

    def gone(_):
        raise OSError(errno.ESTALE, "Stale file handle")

    try:
        monkeypatch.setattr("stereo_gpu.service.service.shutil.disk_usage", gone)
        assert "the data folder cannot be reached: Stale file handle" in one.not_ready()
    finally:
        one.close(0.0)


def test_nothing_begins_where_the_disk_is_short(tmp_path):
    one = Service.open(settings(tmp_path, spare_gb=10.0**6))
    try:
        job = Job(id="d" * 32, client=FIRST_CLIENT, kind=Kind.CALIBRATION, created=time.time())
        one.store.enqueue(job, key=None, fingerprint="", queue_limit=9, client_limit=9)
        one.dispatcher.wake()
        time.sleep(0.3)
        assert one.store.any_job(job.id).state is State.QUEUED
    finally:
        one.close(0.0)


def test_old_jobs_are_swept_at_the_start(tmp_path, monkeypatch):
    given = settings(tmp_path, keep_days=0.0)
    given.data.mkdir()
    store = Store(given.data / "service.sqlite3")
    store.add_client("ann")
    job = Job(id="d" * 32, client="ann", kind=Kind.CALIBRATION, created=1.0)
    store.enqueue(job, key=None, fingerprint="", queue_limit=9, client_limit=9)
    store.ask_cancel("ann", job.id)
    store.close()
    one = Service.open(given)
    try:
        until = time.monotonic() + 30
        while one.store.any_job(job.id) is not None:
            assert time.monotonic() < until
            time.sleep(0.02)
    finally:
        one.close(0.0)


def test_a_sweep_that_fails_is_tried_again(tmp_path, monkeypatch, caplog):
    swept = []

    def sweep(*_):
        swept.append(1)
        if len(swept) == 1:
            raise OSError("the disk hiccupped")
        return 2

    monkeypatch.setattr(housekeeping, "sweep", sweep)
    monkeypatch.setattr(housekeeping, "EVERY_S", 0.01)
    keeping = housekeeping.Housekeeping(None, None, None)
    keeping.start()
    until = time.monotonic() + 30
    while len(swept) < 3:
        assert time.monotonic() < until
        time.sleep(0.01)
    keeping.stop()
    assert "old jobs cannot be removed" in caplog.text


def test_every_gpu_has_workers(tmp_path, monkeypatch):
    class Listed:
        available, kind = True, "gpu"

        def __init__(self, name):
            self.name = name

    monkeypatch.delenv("STEREO_GPU_BACKEND", raising=False)
    monkeypatch.setattr(workers, "usable_cores", lambda: 64)
    listed = [Listed("warp:cuda:0"), Listed("warp:cuda:1"), Listed("opencl:NVIDIA")]
    monkeypatch.setattr(workers, "devices", lambda: listed)
    executor = workers.open_workers(settings(tmp_path, engine="local"))
    assert executor.slots == 16
    executor.close()
    assert workers._devices(settings(tmp_path)) == [{"backend": "warp:cuda:0"}, {"backend": "warp:cuda:1"}]
    assert workers._devices(settings(tmp_path, engine="ray")) == [{"backend": None}]
    listed.clear()
    assert [each["backend"] for each in workers._devices(settings(tmp_path))] == [workers.open_backend(None).name]
