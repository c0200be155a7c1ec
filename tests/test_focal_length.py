"""The focal length of pictures without a rig: given, from EXIF, or guessed."""

import math

import numpy as np
import pytest
from PIL import Image

from stereo_gpu.errors import InputError
from stereo_gpu.focal_length import find_focal_length

SIZE = (640, 480)


def photo(path, tags, size=SIZE):
    image = Image.new("RGB", size)
    exif = Image.Exif()
    exif.get_ifd(0x8769).update(tags)
    image.save(path, exif=exif)
    return path


def test_a_given_one_comes_before_all_else(tmp_path):
    path = photo(tmp_path / "a.jpg", {0xA405: 28})
    found = find_focal_length([path, path], SIZE, given_px=700)
    assert (found.px, found.source, found.guessed) == (700, "given", False)


def test_film_equivalent_goes_by_the_diagonal(tmp_path):
    path = photo(tmp_path / "a.jpg", {0xA405: 28})
    found = find_focal_length([path, path], SIZE)
    assert found.px == pytest.approx(28 / math.hypot(36, 24) * 800)
    assert "28 mm" in found.source and not found.guessed


def test_the_sensors_resolution_comes_first_and_follows_a_shrunk_picture(tmp_path):
    # 1280 px of 5 um were shrunk to 640: 4 mm are 800 px there, 400 px here.
    tags = {0x920A: 4.0, 0xA20E: 2000.0, 0xA210: 3, 0xA002: 1280, 0xA405: 50}
    path = photo(tmp_path / "a.jpg", tags)
    assert find_focal_length([path, path], SIZE).px == pytest.approx(4.0 * 200 / 2)


def test_a_picture_turned_upright_has_the_focal_length_of_the_one_taken(tmp_path):
    tags = {0x920A: 4.0, 0xA20E: 2000.0, 0xA210: 3, 0xA002: 1280, 0xA003: 960}
    path = photo(tmp_path / "a.jpg", tags, SIZE[::-1])
    assert find_focal_length([path, path], SIZE[::-1]).px == pytest.approx(4.0 * 200 / 2)


@pytest.mark.filterwarnings("error")
def test_a_large_picture_is_no_warning(tmp_path, monkeypatch):
    path = photo(tmp_path / "a.jpg", {0xA405: 28})
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 200_000)
    assert not find_focal_length([path, path], SIZE).guessed


@pytest.mark.parametrize("tags", [{}, {0xA405: 0}, {0xA405: 60_000}, {0x920A: 4.0}, {0x920A: 4.0, 0xA20E: 0.0}])
def test_without_a_plausible_tag_it_is_a_guess_and_says_so(tmp_path, tags):
    found = find_focal_length([photo(tmp_path / "a.jpg", tags), np.zeros((480, 640), np.uint8)], SIZE)
    assert (found.px, found.guessed) == (640, True)
    assert "guessed" in found.source


def test_broken_exif_is_none(tmp_path):
    path = photo(tmp_path / "a.jpg", {0xA405: 28})
    data = bytearray(path.read_bytes())
    start = data.index(b"Exif") + 6
    data[start : start + 12] = b"\xff" * 12
    path.write_bytes(data)
    assert find_focal_length([path, path], SIZE).guessed


def test_two_zooms_are_refused(tmp_path):
    paths = [photo(tmp_path / f"{mm}.jpg", {0xA405: mm}) for mm in (28, 50)]
    with pytest.raises(InputError, match="518 and 925 px"):
        find_focal_length(paths, SIZE)


@pytest.mark.parametrize("px", [0, -5, 10, 1e6, math.nan])
def test_an_impossible_one_is_refused(px):
    with pytest.raises(InputError, match="give 192 to 12800 px"):
        find_focal_length([], SIZE, given_px=px)
