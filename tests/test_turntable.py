import io

import cv2
import numpy as np
import pytest
from PIL import Image
from test_render import bump, wall

import stereo_gpu as sg
from stereo_gpu.errors import InputError
from stereo_gpu.render import Renderer
from stereo_gpu.turntable import camera_path, page_film

QUICK = {"size": (61, 40), "seconds": 0.8, "fps": 10}


def quarters():
    texture = np.zeros((64, 80, 3), np.uint8)
    texture[:32, :40], texture[:32, 40:] = (255, 0, 0), (0, 255, 0)
    texture[32:, :40], texture[32:, 40:] = (0, 0, 255), (255, 255, 0)
    return wall(texture)


def test_the_swing_has_no_seam():
    views = np.array(camera_path(6.0, 15.0, 25.0, 3.0, 8.0))
    assert len(views) == 90
    assert views[:, 0].max() == pytest.approx(28, abs=0.1) and views[:, 0].min() == pytest.approx(-22, abs=0.1)
    assert views.mean(axis=0) == pytest.approx([3, 8])
    steps = np.linalg.norm(np.diff(np.vstack([views, views[:1]]), axis=0), axis=1)
    assert steps[-1] == pytest.approx(steps[0], rel=0.05) and steps.max() < 2
    # It does not come back by the way on which it went.
    assert abs(views[10, 1] - views[35, 1]) > 5


def test_a_full_turn_goes_at_an_even_pace():
    views = np.array(camera_path(2.0, 10.0, 360.0, 0.0, 5.0))
    np.testing.assert_allclose(views[:, 0], np.arange(20) * 18)
    assert (views[:, 1] == 5).all()


@pytest.mark.parametrize("suffix", ["gif", "webp"])
def test_pictures_that_loop(tmp_path, suffix):
    told = []
    path = sg.turntable(quarters(), tmp_path / f"turn.{suffix}", **QUICK, progress=lambda *done: told.append(done))
    assert told == [(number, 8) for number in range(1, 9)]
    with Image.open(path) as film:
        assert film.n_frames == 8 and film.size == (61, 40) and film.info["loop"] == 0
        pictures = []
        for number in range(8):
            film.seek(number)
            film.load()
            assert film.info["duration"] == 100
            pictures.append(np.asarray(film.convert("RGB")).astype(int))
    # The pictures are those that render draws, but for what the format loses.
    renderer = Renderer(quarters(), size=(61, 40))
    for picture, camera in zip(pictures, renderer.cameras(camera_path(0.8, 10, 25.0, 0.0, 8.0)), strict=True):
        # WebP halves the resolution of colours, which shows where these four meet.
        assert np.median(np.abs(picture - renderer.draw(camera).astype(int))) <= 2
    assert np.abs(pictures[2] - pictures[6]).mean() > 3


def test_an_mp4_plays(tmp_path):
    path = sg.turntable(quarters(), tmp_path / "turn.MP4", **QUICK)
    film = cv2.VideoCapture(str(path))
    pictures = [film.read()[1] for _ in range(int(film.get(cv2.CAP_PROP_FRAME_COUNT)))]
    film.release()
    assert len(pictures) == 8 and pictures[0].shape == (40, 62, 3)  # even
    assert pictures[0][12, 20, 2] > 180 and pictures[0][12, 20, :2].max() < 90  # red, in OpenCV's order
    assert pictures[0][30, 20, 0] > 180


def test_a_bare_surface(tmp_path):
    assert sg.turntable(bump(12, 9), tmp_path / "turn.gif", shading="wire", **QUICK).stat().st_size > 500


@pytest.mark.parametrize(
    ("name", "options", "says"),
    [
        ("turn.avi", {}, "unknown ending '.avi'.*take .gif"),
        ("turn", {}, "unknown ending ''"),
        ("missing/turn.gif", {}, "no folder"),
        ("turn.gif", {"seconds": 0}, "above 0"),
        ("turn.gif", {"seconds": float("nan")}, "above 0"),
        ("turn.gif", {"fps": 1000}, "up to 100"),
        ("turn.gif", {"seconds": 1e12}, "2 to 3000"),
        ("turn.gif", {"seconds": 0.01}, "2 to 3000"),
        ("turn.gif", {"swing": 200}, "360 for a full turn"),
        ("turn.gif", {"size": (0, 3)}, "at least 1"),
        ("turn.gif", {"shading": "shiny"}, "is unknown"),
    ],
)
def test_what_cannot_be_filmed_is_refused(tmp_path, name, options, says):
    with pytest.raises(InputError, match=says):
        sg.turntable(quarters(), tmp_path / name, **(QUICK | options))
    assert not list(tmp_path.iterdir())


def test_a_fault_on_the_way_leaves_nothing(tmp_path):
    def stop(done, total):
        if done == 3:
            raise KeyboardInterrupt

    for suffix in ("gif", "webp", "mp4"):
        with pytest.raises(KeyboardInterrupt):
            sg.turntable(quarters(), tmp_path / f"turn.{suffix}", **QUICK, progress=stop)
    assert not list(tmp_path.iterdir())


def test_a_film_for_a_page_is_small_and_loops():
    still, packed = page_film(quarters())
    with Image.open(io.BytesIO(packed)) as film:
        assert film.format == "WEBP" and film.n_frames == 16 and film.info["loop"] == 0
        first = np.asarray(film.convert("RGB")).astype(int)
    assert still.shape == first.shape and np.median(np.abs(still - first)) <= 2
    assert len(packed) < 100_000
