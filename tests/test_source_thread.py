"""Sources that hang, fail and come late: nothing of them is left behind."""

import threading
import time

import numpy as np
import pytest

from stereo_gpu.errors import CameraError, InputError
from stereo_gpu.recording import source_thread
from stereo_gpu.recording.source_thread import Stopped
from stereo_gpu.recording.stereo_reader import StereoReader

LIMIT_S = 60  # after which something is taken to hang


class Still:
    """A source that always gives the same picture; `settings` waits for `told`."""

    name, live, stamped, period_s, warm_up_s, refused, ended = "still", False, True, 1.0, 0.0, (), ""

    def __init__(self, told=None):
        self.closed = threading.Event()
        self._told = told
        self._time_s = 0.0

    def grab(self):
        self._time_s += 1.0
        return self._time_s

    def retrieve(self):
        return np.zeros((4, 4), np.uint8)

    @property
    def settings(self):
        if self._told is not None:
            self._told.wait(LIMIT_S)
        return {}

    def close(self):
        self.closed.set()


def read(*openers, stop=None):
    return StereoReader(openers, stall_s=1.0, patience_s=1.0, stop=stop or threading.Event())


def own_threads():
    return [thread for thread in threading.enumerate() if thread.name == "stereo-gpu source"]


def all_threads_end():
    until = time.monotonic() + LIMIT_S
    while own_threads():
        if time.monotonic() > until:
            return False
        time.sleep(0.01)
    return True


def test_a_source_that_cannot_be_opened_leaves_no_thread():
    first = Still()

    def refuse():
        raise InputError("no such camera")

    with pytest.raises(InputError, match="no such camera"):
        read(lambda: first, refuse)
    assert first.closed.wait(LIMIT_S) and all_threads_end()


def test_a_source_that_opens_too_late_is_refused_and_closed(monkeypatch):
    monkeypatch.setattr(source_thread, "FIRST_LIMIT_S", 0.2)
    late, go = Still(), threading.Event()

    def slow():
        go.wait(LIMIT_S)
        return late

    with pytest.raises(InputError, match=r"the left source does not open within .* s: unplug"):
        read(slow)
    assert not late.closed.is_set()
    go.set()
    assert late.closed.wait(LIMIT_S) and all_threads_end()


def test_a_source_that_hangs_when_asked_for_its_settings(monkeypatch):
    monkeypatch.setattr(source_thread, "FIRST_LIMIT_S", 1.0)
    told = threading.Event()
    first, second = Still(), Still(told)
    with pytest.raises(CameraError, match="still hangs"):
        read(lambda: first, lambda: second)
    told.set()
    assert first.closed.wait(LIMIT_S) and second.closed.wait(LIMIT_S) and all_threads_end()


def test_damaged_pictures_of_a_camera_are_passed_over_until_thirty_in_turn():
    def refuse():
        raise InputError("cannot be decoded")

    camera = Still()
    camera.live = True
    reader = read(lambda: camera)
    try:
        given, camera.retrieve = camera.retrieve, refuse
        for _ in range(2):
            for _ in range(29):
                assert reader.step() and reader.decode() is None
            camera.retrieve = given
            assert reader.step() and reader.decode() is not None
            camera.retrieve = refuse
        assert reader.damaged == 58
        for _ in range(29):
            assert reader.step() and reader.decode() is None
        with pytest.raises(InputError, match="cannot be decoded"):
            assert reader.step() and reader.decode()
    finally:
        reader.close()


def test_an_end_while_sources_open_leaves_nothing():
    stop, source, go = threading.Event(), Still(), threading.Event()

    def interrupted():
        stop.set()
        go.wait(LIMIT_S)
        return source

    with pytest.raises(Stopped):
        read(interrupted, stop=stop)
    go.set()
    assert source.closed.wait(LIMIT_S) and all_threads_end()
