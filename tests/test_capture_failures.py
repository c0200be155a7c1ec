"""Capture when things fail: killed, interrupted, a full disk, and cameras that stall, drop pictures, die and return."""

import errno
import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from camera_server import Cameras, number_of, numbered

from stereo_gpu.capture import capture
from stereo_gpu.commands import recording_terminal
from stereo_gpu.commands.recording_terminal import stopping_on_signals
from stereo_gpu.errors import CameraError, InputError
from stereo_gpu.images import read_image

RUN = "import sys; from stereo_gpu.cli import main; sys.exit(main(sys.argv[1:]))"
LIMIT_S = 60  # after which a child is taken to hang


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    """A film long enough to be interrupted."""
    path = tmp_path_factory.mktemp("film") / "film.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 60.0, (320, 240))
    for number in range(1500):
        writer.write(numbered(number, (320, 240)))
    writer.release()
    return str(path)


def command(*arguments, before=""):
    return [sys.executable, "-c", before + RUN, "capture", *map(str, arguments)]


def whole(folder, first=0):
    """The records of the pairs there, whose pictures must be whole and show what they should."""
    text = (folder / "pairs.jsonl").read_text()
    assert text.endswith("\n") or not text
    records = [json.loads(line) for line in text.splitlines()]
    for record in records:
        for side in ("left", "right"):
            assert number_of(read_image(folder / record[side])) == record["frame"] - 1
    for file in folder.glob("*.png"):
        read_image(file)
    return records


def wait_for(condition, limit_s=LIMIT_S):
    until = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.02)


def line_count(folder):
    path = folder / "pairs.jsonl"
    return path.read_bytes().count(b"\n") if path.exists() else 0


@pytest.mark.parametrize("after", [3, 40])
def test_killed_in_the_middle(film, tmp_path, after):
    out = tmp_path / "out"
    child = subprocess.Popen(command(film, film, "--out", out, "--every"), stdout=subprocess.DEVNULL)
    try:
        wait_for(lambda: line_count(out) >= after)
    finally:
        child.kill()
        child.wait()
    records = whole(out)
    assert after <= len(records) < 1500
    # A later run clears what is half done, goes on behind, and touches nothing.
    before = {file.name: file.stat().st_mtime_ns for file in out.glob("*.png")}
    assert capture(film, film, out, count=2, interval=0).taken == 2
    assert len(whole(out)) == len(records) + 2
    assert not list(out.glob(".*"))
    assert all((out / name).stat().st_mtime_ns == written for name, written in before.items())
    sides = [{file.name.removeprefix(side) for file in out.glob(f"{side}*.png")} for side in ("left", "right")]
    assert sides[0] == sides[1]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_in_the_middle(film, tmp_path, number):
    out = tmp_path / "out"
    child = subprocess.Popen(
        command(film, film, "--out", out, "--interval", "0", "--count", "1400"),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        wait_for(lambda: line_count(out) >= 5)
        child.send_signal(number)
        told, errors = child.communicate(timeout=LIMIT_S)
    finally:
        child.kill()
    records = whole(out)
    assert child.returncode == 130 and 5 <= len(records) < 1400
    assert f"{len(records)} pairs taken, 0 dropped" in told and "ended: stopped" in told
    assert told.count("\npair ") + 1 == len(records)
    assert errors == "stereo-gpu: error: interrupted; nothing was left half written\n"
    assert not list(out.glob(".*"))


def test_a_recording_under_nohup_outlives_its_terminal():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stopping_on_signals() as stop:
            signal.raise_signal(signal.SIGHUP)
            assert not stop.signals and not stop.is_set()
            signal.raise_signal(signal.SIGTERM)
            assert stop.signals == [signal.SIGTERM] and stop.is_set()
        assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_signal_is_taken_wherever_the_program_is(monkeypatch):
    with stopping_on_signals() as stop:
        # In the middle of the event's own `set`, whose lock nobody can have twice.
        with stop._cond:
            signal.raise_signal(signal.SIGINT)
            assert stop.is_set()
        signal.raise_signal(signal.SIGTERM)  # the same Ctrl-C, passed on
        assert stop.signals == [signal.SIGINT, signal.SIGTERM]
        monkeypatch.setattr(recording_terminal, "ECHO_S", -1.0)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


def test_all_that_was_taken_is_written_when_nobody_can_be_told(film, tmp_path, monkeypatch):
    class Closed:
        def write(self, text):
            raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(sys, "stdout", Closed())
    stop, chosen = threading.Event(), []

    class Every:
        done, status = False, ""

        def choose(self, frame):
            chosen.append(frame.number)
            return True

    lines = recording_terminal.Lines(None, each=True, status=False, stop=stop)
    recording = capture(film, film, tmp_path, chooser=Every(), count=None, stop=stop, on_pair=lines.pair)
    assert recording.ended == "stopped" and recording.taken == len(chosen) == len(whole(tmp_path)) >= 1


@pytest.mark.parametrize(("limit", "fewest"), [(3000, 3), (200, 0)])
def test_a_full_disk_stops_cleanly(film, tmp_path, limit, fewest):
    # The kernel lets no file grow beyond the limit: the list of pairs, or the first picture.
    out = tmp_path / "out"
    before = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}));"
    done = subprocess.run(
        command(film, film, "--out", out, "--every", before=before), capture_output=True, text=True, timeout=LIMIT_S
    )
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.startswith("stereo-gpu: error: cannot write ") and done.stderr.count("\n") == 1
    assert "File too large; free some room" in done.stderr
    if not fewest:
        assert not out.exists()
        return
    records = whole(out)
    assert len(records) >= fewest and f"; {len(records)} pairs before that are whole in {out}" in done.stderr
    assert len(list(out.iterdir())) == 2 * len(records) + 1
    assert capture(film, film, out, count=1).taken == 1
    assert len(whole(out)) == len(records) + 1


def test_two_recordings_to_one_folder(film, tmp_path):
    out = tmp_path / "out"
    refused = []

    def second(_):
        if not refused:
            with pytest.raises(InputError, match="another recording writes to") as error:
                capture(film, film, out, count=1)
            refused.append(error)

    assert capture(film, film, out, count=3, interval=0, on_pair=second).taken == 3
    assert refused and len(whole(out)) == 3


def test_what_a_dead_run_left_is_finished(film, tmp_path):
    out = tmp_path / "out"
    capture(film, film, out, count=2, interval=0)
    # Killed between the names of the two pictures; killed before either; the list's last line torn.
    (out / "right0002.png").rename(out / ".right0002.png.part")
    (out / ".left0003.png.part").write_bytes(b"half")
    with (out / "pairs.jsonl").open("a") as stream:
        stream.write('{"number": 3, "le')
    capture(film, film, out, count=1)
    assert [record["number"] for record in whole(out)] == [1, 2, 3]
    assert not list(out.glob(".*"))


def test_interrupted_between_the_names_of_two_pictures(film, tmp_path, monkeypatch):
    rename = Path.rename

    def interrupted(path, target):
        if path.name == ".right0002.png.part" and not interrupts:
            interrupts.append(path)
            raise KeyboardInterrupt
        return rename(path, target)

    interrupts = []
    monkeypatch.setattr(Path, "rename", interrupted)
    with pytest.raises(KeyboardInterrupt):
        capture(film, film, tmp_path, count=3, interval=0)
    assert interrupts and len(whole(tmp_path)) == 1
    names = {"pairs.jsonl", *(f"{side}000{number}.png" for side in ("left", "right") for number in (1, 2))}
    assert {file.name for file in tmp_path.iterdir()} == names


def test_a_disk_that_goes_away_is_said_in_one_line(film, tmp_path, monkeypatch):
    def gone(path, *_, **__):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    def pull_out(pair):
        for name in ("rename", "unlink", "rmdir"):
            monkeypatch.setattr(Path, name, gone)

    with pytest.raises(InputError, match=r"cannot write .*: Input/output error; .*; 1 pair before that is whole in "):
        capture(film, film, tmp_path, count=3, interval=0, on_pair=pull_out)


def test_a_folder_that_cannot_be_cleared_is_said_in_one_line(film, tmp_path, monkeypatch):
    def closed(path):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(Path, "iterdir", closed)
    with pytest.raises(InputError, match=r"cannot write .*: Permission denied"):
        capture(film, film, tmp_path, count=1)


def test_a_list_that_is_none_is_left_alone(film, tmp_path):
    (tmp_path / "pairs.jsonl").write_text('{"number": 1}\nmy notes\n')
    with pytest.raises(InputError, match=r"pairs\.jsonl is no list of pairs \(line 2\)"):
        capture(film, film, tmp_path, count=1)
    assert [file.name for file in tmp_path.iterdir()] == ["pairs.jsonl"]
    assert (tmp_path / "pairs.jsonl").read_text() == '{"number": 1}\nmy notes\n'


@pytest.fixture
def cameras():
    served = Cameras()
    yield served
    served.die()


def apart(folder):
    """How many moments lie between the two pictures of a pair; of nearly all, since a busy computer delivers late."""
    records = [json.loads(line) for line in (folder / "pairs.jsonl").read_text().splitlines()]
    shown = [[number_of(read_image(folder / record[side])) for side in ("left", "right")] for record in records]
    return np.quantile([abs(left - right) for left, right in shown], 0.9)


def test_streams_are_paired_by_time(cameras, tmp_path):
    # The right camera's moments are 15 ms after the left one's; both drop pictures, not the same ones.
    left, right = cameras.url("left", fps=20, lost="5-9"), cameras.url("right", fps=20, lost="20-24", late_ms=15)
    left = left.replace("://", "://me:secret@")
    recording = capture(left, right, tmp_path, count=50, interval=0, max_skew_ms=24)
    assert "***@" in (told := (tmp_path / "pairs.jsonl").read_text()) and "secret" not in told
    assert recording.taken == 50 and min(recording.unmatched) >= 4
    assert apart(tmp_path) <= 1  # paired one by one they would be 5 apart after the first gap
    assert recording.skews_ms.max() <= 24


def test_a_stream_that_dies_comes_back(cameras, tmp_path, caplog):
    pairs = []

    def kill(pair):
        pairs.append(pair)
        if len(pairs) == 5:
            cameras.die()
            threading.Timer(1.0, cameras.start).start()

    left, right = cameras.url("left", fps=25), cameras.url("right", fps=25)
    recording = capture(left, right, tmp_path, count=12, interval=0, stall_s=1.0, patience_s=30.0, on_pair=kill)
    assert recording.taken == 12
    assert apart(tmp_path) <= 1
    told = caplog.text
    assert "trying to open it again for 30 s" in told and "is back after" in told


def test_a_stream_that_stalls_is_opened_again(cameras, tmp_path, caplog):
    left, right = cameras.url("left", fps=25), cameras.url("right", fps=25, stall=20)
    recording = capture(left, right, tmp_path, count=30, interval=0, stall_s=0.5, patience_s=30.0)
    assert recording.taken == 30
    assert "right?fps=25&stall=20 has given no picture for 0.5 s: trying to open it again" in caplog.text
    assert apart(tmp_path) <= 1


def test_a_stream_that_stays_away_ends_the_recording(cameras, tmp_path):
    pairs = []

    def kill(pair):
        pairs.append(pair)
        if len(pairs) == 3:
            cameras.die()

    left, right = cameras.url("left", fps=25), cameras.url("right", fps=25)
    with pytest.raises(CameraError, match=r"did not come back within 1 s: .*; \d+ pairs before that are whole in "):
        capture(left, right, tmp_path, count=500, interval=0, stall_s=0.5, patience_s=1.0, on_pair=kill)
    assert line_count(tmp_path) == len(pairs) >= 3
    cameras.start()


def test_a_stream_that_never_says_anything_can_be_interrupted(cameras, tmp_path):
    stop = threading.Event()
    threading.Timer(0.5, stop.set).start()
    recording = capture(cameras.url("left", stall=0), cameras.url("right", stall=0), tmp_path / "out", stop=stop)
    assert recording.taken == 0 and recording.ended == "stopped"
    assert not (tmp_path / "out").exists()
