"""Parts of a recording: keys, camera settings, what differs between two cameras."""

import os
import pty
import signal
import subprocess
import sys
import termios
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from camera_server import Cameras, numbered

from stereo_gpu.cli import main
from stereo_gpu.commands.pictures import split_pictures
from stereo_gpu.errors import InputError
from stereo_gpu.images import read_image
from stereo_gpu.recording.frames import StereoFrame
from stereo_gpu.recording.keys import Keys
from stereo_gpu.recording.same_settings import compare_looks, compare_settings, look_at
from stereo_gpu.recording.settings import CameraSettings

RUN = "import sys; from stereo_gpu.cli import main; sys.exit(main(sys.argv[1:]))"
LIMIT_S = 60


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    path = tmp_path_factory.mktemp("film") / "film.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 60.0, (64, 48))
    for number in range(600):  # longer than a busy computer takes to read three lines of input
        writer.write(numbered(number, (64, 48)))
    writer.release()
    return str(path)


@pytest.fixture(scope="module")
def cameras():
    served = Cameras()
    yield served.url("left", fps=25), served.url("right", fps=25)
    served.die()


def in_terminal(cameras, out, keys, number=None):
    """Capture by keys in a terminal of its own: a key for each pair, then a signal.

    Returns the exit status, what was shown, and the terminal's settings before, meanwhile and after.
    """
    own, child = pty.openpty()
    settings = [termios.tcgetattr(child)]
    command = [sys.executable, "-c", RUN, "capture", *cameras, "--on-key", "--max-skew", "500", "--out", str(out)]
    running = subprocess.Popen(command, stdin=child, stdout=child, stderr=child)
    shown, pressed = b"", 0
    until = time.monotonic() + LIMIT_S
    try:
        os.set_blocking(own, False)
        while running.poll() is None and time.monotonic() < until:
            try:
                shown += os.read(own, 4096)
            except BlockingIOError:
                time.sleep(0.02)
            if b"press Enter" not in shown or shown.count(b"left000") < pressed:
                continue
            if pressed == 0:
                settings.append(termios.tcgetattr(child))
            if pressed < len(keys):
                os.write(own, keys[pressed])
                pressed += 1
            elif number is not None:
                running.send_signal(number)
                number = None
        status = running.poll()
        settings.append(termios.tcgetattr(child))
    finally:
        running.kill()
        running.wait()
        os.close(own)
        os.close(child)
    return status, shown.decode(), settings


@pytest.mark.parametrize(("keys", "number"), [([b"\n", b"xy ", b"q"], None), ([b" "], signal.SIGINT)])
def test_keys_on_a_terminal(cameras, tmp_path, keys, number):
    status, shown, (before, meanwhile, after) = in_terminal(cameras, tmp_path / "out", keys, number)
    count = len(keys) - keys.count(b"q")
    assert status == 0, shown
    assert f"{count} pair{'s' * (count > 1)} taken" in shown and "press Enter or space" in shown
    assert len(list((tmp_path / "out").glob("*.png"))) == 2 * count
    assert not meanwhile[3] & termios.ICANON and meanwhile[3] & termios.ISIG
    assert after == before


def test_lines_instead_of_keys(film, tmp_path):
    command = [sys.executable, "-c", RUN, "capture", film, film, "--on-key", "--out", str(tmp_path / "out")]
    done = subprocess.run(command, input="\n\nlast one\n", capture_output=True, text=True, timeout=LIMIT_S)
    assert done.returncode == 0 and done.stderr == ""
    assert "3 pairs taken" in done.stdout and "ended: no more pairs were wanted" in done.stdout


def test_an_input_that_fails_ends_the_presses(monkeypatch):
    def fail(*_):
        raise OSError("gone")

    monkeypatch.setattr("select.select", fail)
    until = time.monotonic() + LIMIT_S
    with Path(os.devnull).open() as nothing:
        monkeypatch.setattr(sys, "stdin", nothing)
        with Keys() as keys:
            while not keys.ended:
                assert time.monotonic() < until
                time.sleep(0.01)


TOLD = {"fps": 30.0, "exposure": 100.0, "gain": 10.0, "focus": 0.0, "white_balance": 4600.0, "auto_exposure": 1.0}


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({}, None),
        ({"fps": 29.97}, None),
        (
            {"exposure": 210.0},
            "the right camera exposes 2.1 times as long as the left one: set both alike",
        ),
        ({"exposure": 50.0}, "the left camera exposes 2 times as long as the right one"),
        ({"fps": 15.0}, "the left camera runs at 30 pictures a second, the right one at 15: set both alike with --fps"),
        ({"gain": 64.0}, "the right camera has a gain of 64, the left one of 10"),
        ({"focus": 30.0}, "the right camera is focused at 30, the left one at 0"),
        ({"white_balance": 6500.0}, "the right camera has its white balance at 6500, the left one at 4600"),
        ({"auto_exposure": 3.0}, "automatic exposure is on in one camera and off in the other"),
    ],
)
def test_what_drivers_tell_is_compared(changed, says):
    found = compare_settings(TOLD, {**TOLD, **changed})
    assert [sentence.startswith(says) for sentence in found] == ([] if says is None else [True])
    mirrored = compare_settings({**TOLD, **changed}, TOLD)
    assert len(mirrored) == len(found)
    assert compare_settings(TOLD, {name: TOLD[name] for name in TOLD if name not in changed}) == []


def look(left, right):
    return look_at(StereoFrame(number=1, left=left, right=right, left_s=0.0, right_s=0.0))


@pytest.fixture(scope="module")
def views():
    """Two views of a coloured, finely structured scene, 40 px apart."""
    random = np.random.default_rng(4)
    coarse, fine = (cv2.GaussianBlur(random.normal(0, 1, (240, 360, 3)), (0, 0), sigma) for sigma in (12, 0.7))
    scene = np.clip(110 + 25 * coarse / coarse.std() + 15 * fine / fine.std(), 0, 255).astype(np.uint8)
    return scene[:, 40:], scene[:, :320]


def test_what_pictures_show_is_compared(views):
    left, right = views
    assert compare_looks([look(left, right)]) == []
    dim = (right * 0.5).astype(np.uint8)
    soft = cv2.GaussianBlur(right, (0, 0), 2)
    red = np.clip(right * [1.4, 1.0, 1.0], 0, 255).astype(np.uint8)
    for changed, told, says in (
        (
            dim,
            ("exposure", "gain"),
            "times as bright as those of the right one: set both alike with --exposure",
        ),
        (soft, ("focus",), "times as sharp as those of the right one: focus both"),
        (red, ("white_balance",), "times redder than those of the left one: set both alike with --white-balance"),
    ):
        [sentence] = compare_looks([look(left, changed)])
        assert says in sentence
        assert compare_looks([look(left, changed)], told) == []
    assert compare_looks([look(left[..., 1], right[..., 1])]) == []
    [sentence] = compare_looks([look(left, np.zeros_like(right))])
    assert sentence == "the right picture is black: take the cap off, or light the scene"


@pytest.mark.parametrize("name", ["rigs/cup/calibration_images", "rigs/cup/test_images", "calibration/board_10x7"])
def test_real_pairs_that_were_taken_alike_give_no_warning(data, name):
    left, right = (sorted((data / name).glob(f"{side}*"))[:6] for side in ("left", "right"))
    assert left
    assert compare_looks([look(read_image(a), read_image(b)) for a, b in zip(left, right, strict=True)]) == []


@pytest.mark.parametrize(
    ("option", "says"),
    [
        ({"size": (0, 480)}, "size = "),
        ({"fps": 0.0}, "fps = 0"),
        ({"fps": float("nan")}, "fps = nan"),
        ({"exposure": float("inf")}, "exposure = inf"),
        ({"fourcc": "JPEG2000"}, "fourcc = 'JPEG2000'"),
    ],
)
def test_wrong_settings(option, says):
    with pytest.raises(InputError, match=says):
        CameraSettings(**option)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("a",), "a is one source: name the right camera too, or say --side-by-side"),
        (("a", "b", "--side-by-side"), "--side-by-side is for one source"),
        (("a", "b", "--size", "640"), "'640': give width x height"),
        (("a", "b", "--square", "30"), "--square 30.0: it is for --board"),
        (("a", "b", "--board", "10x7", "--dictionary", "5x5_250"), "stands without --marker"),
        (("a", "b", "--board", "ten"), "10x7"),
        (("a", "b", "--every", "--on-key"), "not allowed with"),
        (("a", "b", "--max-skew", "-1"), "max_skew_ms = -1"),
        (("a", "b", "--patience", "nan"), "patience_s = nan"),
        (("a.avi", "b.avi", "--fps", "0"), "fps = 0"),
    ],
)
def test_wrong_arguments(capsys, tmp_path, monkeypatch, arguments, says):
    monkeypatch.chdir(tmp_path)
    assert main(["capture", *arguments, "--out", "new"]) == 2
    shown = capsys.readouterr()
    assert says in shown.err and shown.err.count("\n") == 1 and shown.out == ""
    assert not list(tmp_path.iterdir())


def test_the_folder_of_a_recording_can_be_calibrated(film, tmp_path, caplog):
    assert main(["capture", film, film, "--out", str(tmp_path / "out"), "--interval", "0", "--count", "3"]) == 0
    (tmp_path / "out" / "left0009.png").write_bytes(b"")
    left, right = split_pictures([str(tmp_path / "out")])
    assert [path.name for path in left] == [f"left000{number}.png" for number in (1, 2, 3)]
    assert [path.name for path in right] == [f"right000{number}.png" for number in (1, 2, 3)]
    assert "left0009.png" in caplog.text and "has no partner: left out" in caplog.text
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="holds no pair"):
        split_pictures([str(tmp_path / "empty")])
