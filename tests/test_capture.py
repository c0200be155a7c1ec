"""Taking pairs, with video files as cameras."""

import cv2
import numpy as np
import pytest

from stereo_gpu.capture import capture
from stereo_gpu.errors import InputError
from stereo_gpu.images import read_image

FRAMES, RATE = 12, 4.0
CODED = 12  # grey levels that JPEG changes at most on a flat picture


def video(path, size=(64, 48), frames=FRAMES, base=0):
    """A video whose frame n is flat, base + 10 n grey levels in its red channel, so that each tells its number."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), RATE, size)
    assert writer.isOpened()
    for number in range(frames):
        writer.write(np.full((size[1], size[0], 3), (0, 0, base + 10 * number), np.uint8))
    writer.release()
    return str(path)


@pytest.fixture
def cameras(tmp_path):
    return video(tmp_path / "left.avi"), video(tmp_path / "right.avi", base=100)


def numbers(folder, side, base):
    return [round((np.median(read_image(path)[..., 0]) - base) / 10) for path in sorted(folder.glob(f"{side}*.png"))]


def test_pairs_are_written_in_step(cameras, tmp_path):
    out = tmp_path / "new" / "out"
    taken = list(capture(*cameras, out, count=3, interval=0))
    assert [pair.number for pair in taken] == [1, 2, 3]
    assert [pair.left.name for pair in taken] == ["left0001.png", "left0002.png", "left0003.png"]
    assert sorted(path.name for path in out.iterdir()) == sorted(
        path.name for pair in taken for path in (pair.left, pair.right)
    )
    assert all(0 <= pair.skew_ms < 1000 for pair in taken)
    first = read_image(taken[0].right)
    assert first.shape == (48, 64, 3)
    assert abs(float(first[..., 0].mean()) - 100) < CODED and first[..., 2].mean() < CODED  # red, so RGB order
    assert numbers(out, "left", 0) == numbers(out, "right", 100) == [0, 1, 2]


def test_a_video_plays_at_its_own_speed_until_it_ends(cameras, tmp_path):
    taken = list(capture(*cameras, tmp_path / "out", count=99, interval=1.0))
    assert numbers(tmp_path / "out", "left", 0) == [0, 4, 8]
    assert len(taken) == 3


def test_a_missing_camera_leaves_nothing(cameras, tmp_path):
    for pair in ((str(tmp_path / "no.avi"), cameras[1]), (cameras[0], "/dev/video97"), (cameras[0], "")):
        with pytest.raises(InputError, match="cannot be opened"):
            list(capture(*pair, tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_unequal_sizes_leave_nothing(cameras, tmp_path):
    small = video(tmp_path / "small.avi", size=(32, 48))
    with pytest.raises(InputError, match=r"gives 64 x 48, .*small\.avi gives 32 x 48: set both cameras to one size"):
        list(capture(cameras[0], small, tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_wrong_options(cameras, tmp_path):
    for option, says in (
        ({"count": 0}, "count = 0"),
        ({"interval": -1.0}, "interval = -1"),
        ({"interval": float("nan")}, "interval = nan"),
    ):
        with pytest.raises(InputError, match=says):
            list(capture(*cameras, tmp_path / "out", **option))
    with pytest.raises(InputError, match="is a file"):
        list(capture(*cameras, tmp_path / "left.avi"))
    assert not (tmp_path / "out").exists()
