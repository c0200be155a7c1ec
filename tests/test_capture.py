"""Taking pairs, with video files, folders and network streams as cameras."""

import json
import os
import signal
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from camera_server import number_of, numbered

from stereo_gpu.capture import capture
from stereo_gpu.errors import CameraError, InputError
from stereo_gpu.images import read_image

SIZE = (64, 48)
RATE = 60.0
COMMAND = [sys.executable, "-c", "import sys; from stereo_gpu.cli import main; sys.exit(main(sys.argv[1:]))", "capture"]


def video(path, numbers, size=SIZE, rate=RATE, first=0):
    """An MPEG-4 video whose pictures show `numbers`; where one is left out its time passes, as in a recording."""
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"mp4v"), rate, size)
    assert writer.isOpened()
    numbers = list(numbers)
    for number in numbers:
        writer.write(numbered(first + number, size))
    writer.release()
    steps = [after - before for before, after in zip(numbers, numbers[1:], strict=False)] + [1]
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
    capture(tmp_path / "red.avi", tmp_path / "red.avi", tmp_path / "out", count=1)
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
    assert recording.taken == 1 and recording.dropped == 19
    assert "1 pair taken, 19 dropped" in str(recording)
    kept = capture(left, right, tmp_path / "all", count=None, interval=0)
    assert kept.taken == 20 and kept.dropped == 0
    assert np.median(kept.skews_ms) == pytest.approx(1000 / 120, abs=0.1)
    assert "8.3 ms (median), 8.3 ms (95 %), 8.3 ms (largest)" in str(kept)
