"""Taking pairs, with video files, folders and network streams as cameras."""

import json
import struct
import threading
import time
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from camera_server import number_of, numbered

from stereo_gpu.capture import capture
from stereo_gpu.cli import main
from stereo_gpu.errors import InputError
from stereo_gpu.images import read_image
from stereo_gpu.recording.settings import CameraSettings

SIZE = (64, 48)
RATE = 60.0


def video(path, numbers, size=SIZE, rate=RATE, first=0):
    """An MPEG-4 video whose pictures show `numbers`; where one is left out its time passes, as in a recording."""
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"mp4v"), rate, size)
    assert writer.isOpened()
    numbers = list(numbers)
    for number in numbers:
        writer.write(numbered(first + number, size))
    writer.release()
    steps = [*(after - before for before, after in pairwise(numbers)), 1]
    if set(steps) != {1}:
        set_times(path, steps)
    return str(path)


def set_times(path, steps):
    """Give each picture of an MP4 file its own duration, in periods: OpenCV itself writes them all alike."""
    data = bytearray(path.read_bytes())
    table = data.find(b"stts") - 4
    size, entries, period = (struct.unpack_from(">I", data, table + at)[0] for at in (0, 12, 20))
    assert entries == 1
    rows = b"".join(struct.pack(">II", 1, step * period) for step in steps)
    new = struct.pack(">I4sII", 16 + len(rows), b"stts", 0, len(steps)) + rows
    data[table : table + size] = new
    for box in (b"moov", b"trak", b"mdia", b"minf", b"stbl"):
        at = data.find(box) - 4
        struct.pack_into(">I", data, at, struct.unpack_from(">I", data, at)[0] + len(new) - size)
    # It would end the film when it would have ended with the old times.
    at = data.find(b"edts")
    data[at : at + 4] = b"free"
    path.write_bytes(data)


@pytest.fixture
def films(tmp_path):
    return video(tmp_path / "left.mp4", range(60)), video(tmp_path / "right.mp4", range(60))


def listed(folder):
    """The records of a folder's pairs, after making sure that all that is there is whole."""
    text = (folder / "pairs.jsonl").read_text()
    assert text.endswith("\n")
    records = [json.loads(line) for line in text.splitlines()]
    for record in records:
        for side in ("left", "right"):
            height, width = read_image(folder / record[side]).shape[:2]
            assert [width, height] == record["size"]
    return records


def seen(folder, records):
    """The numbers that the pictures of each pair show."""
    return [tuple(number_of(read_image(folder / record[side])) for side in ("left", "right")) for record in records]


def test_pairs_are_written_in_step(films, tmp_path):
    out = tmp_path / "new" / "out"
    told = []
    recording = capture(*films, out, count=3, interval=0, on_pair=told.append)
    assert recording.taken == 3 and recording.dropped == 0
    assert [(pair.number, pair.left.name, pair.right.name) for pair in told] == [
        (number, f"left000{number}.png", f"right000{number}.png") for number in (1, 2, 3)
    ]
    assert sorted(path.name for path in out.iterdir()) == sorted(
        ["pairs.jsonl", *(path.name for pair in told for path in (pair.left, pair.right))]
    )
    records = listed(out)
    assert seen(out, records) == [(0, 0), (1, 1), (2, 2)]
    assert [record["left_s"] for record in records] == pytest.approx([0, 1 / 60, 2 / 60], abs=1e-5)
    assert records[0]["sources"] == list(films) and records[0]["settings"] == [{"fps": 60.0}] * 2


def test_colours_stay_as_they_are(tmp_path):
    writer = cv2.VideoWriter(str(tmp_path / "red.avi"), cv2.VideoWriter.fourcc(*"MJPG"), RATE, SIZE)
    writer.write(np.full((48, 64, 3), (20, 60, 200), np.uint8))  # BGR
    writer.release()
    recording = capture(tmp_path / "red.avi", tmp_path / "red.avi", tmp_path / "out", count=1)
    assert recording.ended == "the pair was taken"
    assert np.abs(np.median(read_image(tmp_path / "out" / "left0001.png"), axis=(0, 1)) - (200, 60, 20)).max() < 6


def test_a_video_plays_at_its_own_speed_until_it_ends(films, tmp_path):
    recording = capture(*films, tmp_path / "out", count=99, interval=0.25)
    assert seen(tmp_path / "out", listed(tmp_path / "out")) == [(number, number) for number in (0, 15, 30, 45)]
    assert "left.mp4 ended after 60 pictures" in recording.ended


def test_a_later_run_goes_on_and_writes_over_nothing(films, tmp_path):
    capture(*films, tmp_path / "out", count=2, interval=0)
    (tmp_path / "out" / "left0007.png").write_bytes(b"mine")
    capture(*films, tmp_path / "out", count=2, interval=0.5)
    assert [record["number"] for record in listed(tmp_path / "out")] == [1, 2, 8, 9]
    assert (tmp_path / "out" / "left0007.png").read_bytes() == b"mine"


def test_a_source_that_dropped_pictures_is_realigned(tmp_path):
    kept = [number for number in range(60) if number not in (5, 6, 7, 31)]
    left, right = video(tmp_path / "left.mp4", range(60)), video(tmp_path / "right.mp4", kept)
    recording = capture(left, right, tmp_path / "out", count=None, interval=0)
    records = listed(tmp_path / "out")
    assert seen(tmp_path / "out", records) == [(number, number) for number in kept]
    assert recording.unmatched == (4, 0) and recording.dropped == 0
    assert max(record["skew_ms"] for record in records) < 0.1


def test_sources_of_different_speed_are_paired_by_time(tmp_path):
    left, right = video(tmp_path / "left.mp4", range(60)), video(tmp_path / "right.mp4", range(30), rate=30.0)
    recording = capture(left, right, tmp_path / "out", count=None, interval=0)
    pairs = seen(tmp_path / "out", listed(tmp_path / "out"))
    assert [a for a, _ in pairs] == [2 * b for _, b in pairs] and len(pairs) >= 29
    assert recording.unmatched[0] >= 28


def test_pairs_too_far_apart_are_dropped_and_counted(tmp_path):
    # 40 pictures a second; from the second one on the right ones come 1/120 s later.
    left = video(tmp_path / "left.mp4", range(0, 60, 3), rate=120.0)
    right = video(tmp_path / "right.mp4", [0, *range(4, 61, 3)], rate=120.0)
    recording = capture(left, right, tmp_path / "out", count=None, interval=0, max_skew_ms=5)
    assert seen(tmp_path / "out", listed(tmp_path / "out")) == [(0, 0)]
    assert recording.taken == recording.seen == 1 and recording.dropped == 19
    assert "1 pair taken, 19 dropped" in str(recording)
    kept = capture(left, right, tmp_path / "all", count=None, interval=0)
    assert kept.taken == 20 and kept.dropped == 0
    assert np.median(kept.skews_ms) == pytest.approx(1000 / 120, abs=0.1)
    assert "8.3 ms (median), 8.3 ms (95 %), 8.3 ms (largest)" in str(kept)


def test_one_camera_with_both_views(tmp_path):
    both = [np.hstack([numbered(number, SIZE), numbered(1000 + number, SIZE)]) for number in range(4)]
    writer = cv2.VideoWriter(str(tmp_path / "both.avi"), cv2.VideoWriter.fourcc(*"MJPG"), RATE, (128, 48))
    for picture in both:
        writer.write(picture)
    writer.release()
    recording = capture(tmp_path / "both.avi", None, tmp_path / "out", count=None, interval=0)
    assert seen(tmp_path / "out", listed(tmp_path / "out")) == [(number, 1000 + number) for number in range(4)]
    assert recording.skews_ms.max() == 0
    (tmp_path / "odd").mkdir()
    cv2.imwrite(str(tmp_path / "odd" / "1.png"), np.zeros((48, 127, 3), np.uint8))
    with pytest.raises(InputError, match=r"odd gives pictures 127 px wide"):
        capture(tmp_path / "odd", None, tmp_path / "none")
    assert not (tmp_path / "none").exists()


def folder(path, names, numbers):
    path.mkdir()
    for name, number in zip(names, numbers, strict=True):
        cv2.imwrite(str(path / name), numbered(number, SIZE))
    return path


def test_folders_that_count_the_same_moments(tmp_path):
    kept = [number for number in range(1, 13) if number != 5]
    left = folder(tmp_path / "l", [f"cam0_{number}.png" for number in range(1, 13)], range(1, 13))
    right = folder(tmp_path / "r", [f"cam1_{number}.png" for number in kept], kept)
    recording = capture(left, right, tmp_path / "out", count=None, interval=0)
    assert seen(tmp_path / "out", listed(tmp_path / "out")) == [(number, number) for number in kept]
    assert recording.unmatched == (1, 0)


def test_folders_with_other_numbers_are_taken_in_order(tmp_path):
    left = folder(tmp_path / "l", [f"dsc{number}.jpg" for number in (8, 9, 10)], (8, 9, 10))
    right = folder(tmp_path / "r", [f"img{number}.jpg" for number in (71, 72, 73)], (71, 72, 73))
    capture(left, right, tmp_path / "out", count=None, interval=0)
    assert seen(tmp_path / "out", listed(tmp_path / "out")) == [(8, 71), (9, 72), (10, 73)]


class Slow:
    """Takes every pair, each only when the sources have come to their end; fails at the pair of number `fails_at`."""

    done, status = False, ""

    def __init__(self, fails_at=0):
        self.fails_at = fails_at

    def choose(self, frame):
        until = time.monotonic() + 60
        while any(thread.name == "stereo-gpu feed" for thread in threading.enumerate()):
            assert time.monotonic() < until
            time.sleep(0.01)
        if frame.number == self.fails_at:
            raise ZeroDivisionError
        return True


def test_a_picture_that_fails_while_the_last_one_is_looked_at(tmp_path):
    for side in ("l", "r"):
        folder(tmp_path / side, ["1.png"], [1])
        (tmp_path / side / "2.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"2\.png.*; 1 pair before that is whole in "):
        capture(tmp_path / "l", tmp_path / "r", tmp_path / "out", chooser=Slow(), count=None)
    assert seen(tmp_path / "out", listed(tmp_path / "out")) == [(1, 1)]


def test_what_was_taken_before_a_chooser_failed_is_written(tmp_path):
    left, right = (folder(tmp_path / side, ["1.png", "2.png"], [1, 2]) for side in ("l", "r"))
    with pytest.raises(ZeroDivisionError):
        capture(left, right, tmp_path / "out", chooser=Slow(fails_at=2), count=None)
    assert seen(tmp_path / "out", listed(tmp_path / "out")) == [(1, 1)]


def test_a_number_means_a_camera_even_where_a_folder_is_called_so(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("97", "98"):
        folder(tmp_path / name, ["1.png"], [1])
    with pytest.raises(InputError, match="'97' cannot be opened"):
        capture(97, 98, "out")
    assert capture("./97", "./98", "out").taken == 1


def test_folders_with_time_stamps_in_their_names(tmp_path):
    stamps = [1403636579763555584 + 50_000_000 * number for number in range(4)]
    left = folder(tmp_path / "l", [f"{stamp}.png" for stamp in stamps], range(4))
    right = folder(tmp_path / "r", [f"{stamp + 3_000_000}.png" for stamp in stamps], range(4))
    recording = capture(left, right, tmp_path / "out", count=None, interval=0.1)
    assert seen(tmp_path / "out", listed(tmp_path / "out")) == [(0, 0), (2, 2)]
    assert recording.skews_ms == pytest.approx([3, 3], abs=0.01)


def test_folders_of_different_days(tmp_path, capsys):
    left = folder(tmp_path / "l", [f"{1403636579763555584 + 50_000_000 * number}.png" for number in range(4)], range(4))
    right = folder(
        tmp_path / "r", [f"{1503636579763555584 + 50_000_000 * number}.png" for number in range(3)], range(3)
    )
    assert main(["capture", str(left), str(right), "--out", str(tmp_path / "out")]) == 2
    shown = capsys.readouterr()
    assert f"no pair was taken: by their times, no pictures of {left} and {right} belong together" in shown.err
    assert shown.err.count("\n") == 1 and shown.out == "" and not (tmp_path / "out").exists()


def test_sources_that_are_none_leave_nothing(films, tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.mp4").write_text("no film")
    (tmp_path / "cut.mp4").write_bytes(Path(films[0]).read_bytes()[:300])
    for left, right, says in (
        (tmp_path / "no.avi", films[1], r"no\.avi' cannot be opened"),
        ("/dev/video97", "/dev/video98", "'/dev/video97' cannot be opened"),
        (97, 98, "'97' cannot be opened"),
        (10**30, 98, "cannot be opened"),
        ("9" * 5000, 98, "cannot be opened"),
        ("\u00b2", films[1], "'\u00b2' cannot be opened"),
        ("a" * 300, films[1], "cannot be opened"),
        ("http://127.0.0.1:9/" + "a" * 300, "http://127.0.0.1:9/no", "cannot be opened"),
        (films[0], "", "'' cannot be opened"),
        (films[0], "a\0b", "cannot be opened"),
        (films[0], "/dev/video97", "left.mp4 is a video file, /dev/video97 is a camera or stream: their times"),
        (films[0], tmp_path / "empty", "is a folder: their times"),
        (tmp_path / "empty", tmp_path / "empty", "holds no picture"),
        (tmp_path / "text.mp4", films[1], "cannot be opened"),
        (tmp_path / "cut.mp4", films[1], "cannot be opened"),
        (0, 0, "0 is given for both cameras"),
        ("http://me:secret@127.0.0.1:9/", "http://127.0.0.1:9/no", r"'http://\*\*\*@127.0.0.1:9/' cannot be opened"),
        ("http://me:secret@c/", "http://me:secret@c/", r"http://\*\*\*@c/ is given for both cameras"),
        ("http://me:secret@c/", films[1], r"http://\*\*\*@c/ is a camera or stream"),
        ("http://127.0.0.1:9/none", "http://127.0.0.1:9/no", "'http://127.0.0.1:9/none' cannot be opened"),
    ):
        with pytest.raises(InputError, match=says) as refused:
            capture(left, right, tmp_path / "out")
        assert "\n" not in str(refused.value)
    assert not (tmp_path / "out").exists()


def test_unequal_sizes_leave_nothing(films, tmp_path):
    small = video(tmp_path / "small.mp4", range(9), size=(32, 48))
    with pytest.raises(InputError, match=r"gives 64 x 48, .*small\.mp4 gives 32 x 48: set both cameras to one size"):
        capture(films[0], small, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_wrong_options(films, tmp_path):
    for option, says in (
        ({"count": 0}, "count = 0"),
        ({"interval": -1.0}, "interval = -1"),
        ({"interval": float("nan")}, "interval = nan"),
        ({"max_skew_ms": float("nan")}, "max_skew_ms = nan"),
        ({"stall_s": 0.0}, "stall_s = 0"),
        ({"patience_s": -1.0}, "patience_s = -1"),
    ):
        with pytest.raises(InputError, match=says):
            capture(*films, tmp_path / "out", **option)
    with pytest.raises(InputError, match="is a file"):
        capture(*films, tmp_path / "left.mp4")
    assert not (tmp_path / "out").exists()


def test_a_film_that_is_cut_off_says_so(tmp_path):
    writer = cv2.VideoWriter(str(tmp_path / "whole.avi"), cv2.VideoWriter.fourcc(*"MJPG"), RATE, SIZE)
    for number in range(60):
        writer.write(numbered(number, SIZE))
    writer.release()
    data = (tmp_path / "whole.avi").read_bytes()
    (tmp_path / "cut.avi").write_bytes(data[: len(data) // 2])
    recording = capture(tmp_path / "cut.avi", tmp_path / "whole.avi", tmp_path / "out", count=None, interval=0)
    assert 10 < recording.taken < 50 and len(listed(tmp_path / "out")) == recording.taken
    assert "of the 60 that it says it has; it may be cut off" in recording.ended


def test_nothing_is_lost_at_60_a_second(tmp_path):
    """Acceptance: 1,000 pairs of 640 x 480 from two films of 60 a second, none lost, the skew reported."""
    size, count = (640, 480), 1000
    films = [
        video(tmp_path / f"{side}.mp4", range(count), size, first=first) for side, first in (("l", 0), ("r", 5000))
    ]
    recording = capture(*films, tmp_path / "out", count=None, interval=0)
    assert recording.taken == count and recording.dropped == 0 and recording.unmatched == (0, 0)
    assert recording.passed_over == 0 and recording.skews_ms.shape == (count,)
    assert str(recording).startswith("1,000 pairs taken, 0 dropped for their skew; skew 0.0 ms (median)")
    records = [json.loads(line) for line in (tmp_path / "out" / "pairs.jsonl").read_text().splitlines()]
    assert [record["number"] for record in records] == list(range(1, count + 1))
    assert {tuple(record["size"]) for record in records} == {size}
    for at in (*range(0, count, 50), count - 1):
        pair = [number_of(read_image(tmp_path / "out" / records[at][side])) for side in ("left", "right")]
        assert pair == [at, 5000 + at]


def test_settings_that_only_a_camera_has_are_not_passed_over(films, tmp_path):
    recording = capture(*films, tmp_path / "out", count=1, settings=CameraSettings(exposure=50, lock=True))
    assert recording.taken == 1
    told = [warning for warning in recording.warnings if "did not take exposure, lock" in warning]
    assert len(told) == 2
