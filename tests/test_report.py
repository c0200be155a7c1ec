import base64
import re

import cv2
import numpy as np
import pytest
from pages import Page

from stereo_gpu.errors import InputError, PictureError
from stereo_gpu.report import Figure, write_report
from stereo_gpu.types import Mesh


def noise(height, width, seed=0):
    return np.random.default_rng(seed).integers(0, 255, (height, width, 3), np.uint8)


def triangle():
    return Mesh(
        vertices=np.array([[-100, -100, 900], [-100, 100, 900], [100, 0, 950]], np.float32),
        faces=np.array([[0, 1, 2]], np.int32),
        uv=np.array([[0, 0], [0, 1], [1, 0.5]], np.float32),
        texture=noise(32, 32),
    )


def write(tmp_path, **changes):
    settings = {
        "title": "pair",
        "figures": [Figure(name="Disparity", caption="Red is near.", picture=noise(30, 40))],
        "facts": {"Backend": "warp:cpu", "Counts": {"Triangles": "1,234"}},
        "seconds": {"match": 3.0, "mesh": 1.0},
    }
    path = write_report(tmp_path / "report.html", **(settings | changes))
    return path.read_text(encoding="utf-8")


def pixels(source):
    kind, _, data = source.partition(";base64,")
    picture = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)
    return kind, picture[..., ::-1]


def test_shows_everything_once_and_closes_every_tag(tmp_path):
    page = Page(write(tmp_path, warnings=["Range hit: widen it."], mesh=triangle()))
    assert page.balanced
    for words in (
        "pair",
        "Range hit: widen it.",
        "warp:cpu",
        "Triangles",
        "1,234",
        "3.00 s",
        "4.00 s",
        "Red is near.",
    ):
        assert words in page.text
    assert page.all("img")[0]["alt"] == "Disparity: Red is near."
    assert page.text.index("Range hit") < page.text.index("Red is near.")


def test_nothing_from_outside_becomes_markup(tmp_path):
    evil = "</title><script>alert('1')</script>\"$title&amp;"
    text = write(
        tmp_path,
        title=evil,
        figures=[Figure(name=evil, caption=evil, picture=noise(9, 9))],
        facts={evil: evil, evil + "2": {evil: evil}},
        seconds={evil: 1.0},
        warnings=[evil],
    )
    page = Page(text)
    assert page.balanced
    assert not page.all("script")
    assert page.text.count(evil) == 11  # title, heading, warning, name, caption, stage, five in the facts
    assert page.all("img")[0]["alt"] == f"{evil}: {evil}"


def test_loads_nothing_from_the_network(tmp_path):
    text = write(tmp_path, mesh=triangle())
    page = Page(text)
    policy = next(tag["content"] for tag in page.all("meta") if "http-equiv" in tag)
    assert policy.startswith("default-src 'none'") and "http" not in policy
    for tag, attributes in page.tags:
        for name in ("src", "href"):
            assert attributes.get(name, "data:").startswith("data:"), tag


def test_the_frame_holds_the_viewer_whole(tmp_path):
    frame = Page(write(tmp_path, mesh=triangle())).all("iframe")[0]
    inner = frame["srcdoc"]
    assert inner.rstrip().endswith("</html>")
    assert 'const glb="' in inner and "&quot;" not in inner.split('const glb="')[1]
    assert not Page(write(tmp_path)).all("iframe")


def test_pictures_come_back_as_they_were(tmp_path):
    flat = np.zeros((60, 80, 3), np.uint8)
    flat[:30] = (250, 120, 10)
    y, x = np.mgrid[:120, :160]
    photo = np.stack([x, 2 * y, 255 - x], -1).astype(np.uint8) // 4 * 3 + noise(120, 160) // 32
    deep = np.full((20, 30), 40000, np.uint16)
    figures = [Figure(name="f", caption="c", picture=picture) for picture in (flat, photo, deep)]
    (flat_kind, flat_again), (photo_kind, photo_again), (_, deep_again) = (
        pixels(tag["src"]) for tag in Page(write(tmp_path, figures=figures)).all("img")
    )
    assert (flat_kind, photo_kind) == ("data:image/png", "data:image/jpeg")
    np.testing.assert_array_equal(flat_again, flat)
    assert np.abs(photo_again.astype(int) - photo).mean() < 4
    assert (deep_again == 156).all()


def test_a_film_moves_on_screens_in_place_of_its_picture(tmp_path):
    figure = Figure(name="Turned", caption="To and fro.", picture=noise(30, 40), film=b"RIFF film")
    page = Page(write(tmp_path, figures=[figure]))
    assert page.balanced
    (source,) = page.all("source")
    kind, _, data = source["srcset"].partition(";base64,")
    assert (kind, base64.b64decode(data)) == ("data:image/webp", b"RIFF film")
    assert "screen" in source["media"] and "prefers-reduced-motion" in source["media"]
    assert page.all("img")[0]["alt"] == "Turned: To and fro."


def test_wide_pictures_are_shrunk_and_take_the_row(tmp_path):
    text = write(tmp_path, figures=[Figure(name="f", caption="c", picture=noise(100, 4000))])
    assert '<figure class="wide">' in text
    assert pixels(Page(text).all("img")[0]["src"])[1].shape == (40, 1600, 3)


def test_bars_compare_with_the_longest_stage(tmp_path):
    widths = [float(width) for width in re.findall(r'class="bar" style="width:([\d.]+)%"', write(tmp_path))]
    assert widths == [100.0, pytest.approx(33.3)]
    idle = write(tmp_path, seconds={"match": 0.0})
    assert 'style="width:0.0%"' in idle


def test_empty_report_says_so(tmp_path):
    text = write(tmp_path, figures=[], facts={}, seconds={})
    assert "No warnings." in text
    assert "<figure" not in text and "Numbers" not in text
    assert Page(text).balanced


def test_errors_leave_nothing_behind(tmp_path):
    with pytest.raises(PictureError, match="float64"):
        write(tmp_path, figures=[Figure(name="f", caption="c", picture=np.zeros((4, 5)))])
    with pytest.raises(InputError, match="no folder"):
        write(tmp_path / "missing")
    assert not list(tmp_path.iterdir())
