"""Views to paint on over HTTP: made, painted, refused, forgotten, and kept from others."""

import errno
import io
import shutil
import threading
import time

import numpy as np
import pytest
from conftest import missing
from PIL import Image

from stereo_gpu.images import read_image
from stereo_gpu.mask import Stroke, mask_from_strokes
from stereo_gpu.rectify import rectify
from stereo_gpu.rig import Rig
from stereo_gpu.service.jobs.outline_work import do_task
from stereo_gpu.service.refusals import DiskFull

try:
    from serving import add_rig, pair_of, serving
except ModuleNotFoundError:  # the extra
    serving = None

BRUSH = {"radius": 6, "points": [[160, 60], [165, 120.5]]}
BESIDE = {"radius": 9, "points": [[5, 20], [315, 20]]}


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    if serving is None:
        missing("service", 'pip install "stereo-gpu[service]"')
    with serving(tmp_path_factory.mktemp("outlines") / "data", engine="inline", workers=None) as served:
        yield served


@pytest.fixture(scope="module")
def client(served):
    with served.client() as client:
        yield client


@pytest.fixture(scope="module")
def rig(client, raw_folder):
    return add_rig(client, raw_folder)


@pytest.fixture(scope="module")
def outline(client, raw_folder, rig):
    answer = client.post("/v1/outlines", files=pair_of(raw_folder), data={"rig": rig})
    assert answer.status_code == 201, answer.text
    return answer.json()


def opened(answer):
    return np.asarray(Image.open(io.BytesIO(answer.content)))


@pytest.mark.parametrize("reference", ["right", "left"])
def test_the_view_is_the_rectified_one(client, raw_folder, rig, reference):
    answer = client.post("/v1/outlines", files=pair_of(raw_folder), data={"rig": rig, "reference": reference})
    outline = answer.json()
    assert (outline["width"], outline["height"]) == (320, 240)
    picture = client.get(outline["picture"])
    assert picture.headers["content-type"] == "image/jpeg"
    sides = (read_image(raw_folder / f"{side}.png") for side in ("left", "right"))
    view = getattr(rectify(*sides, Rig.load(raw_folder / "rig.json")), reference)
    assert np.abs(opened(picture).astype(int) - view).mean() < 4  # JPEG's loss


def test_the_mask_is_that_of_the_library(client, raw_folder, outline):
    painted = {"rectangle": [100, 20, 140, 160], "wanted": [BRUSH], "unwanted": [BESIDE]}
    answer = client.post(f"/v1/outlines/{outline['id']}/mask", json=painted)
    assert answer.status_code == 200 and answer.headers["content-type"] == "image/png"
    sides = (read_image(raw_folder / f"{side}.png") for side in ("left", "right"))
    view = rectify(*sides, Rig.load(raw_folder / "rig.json")).right
    strokes = {name: [Stroke(**painted[name][0])] for name in ("wanted", "unwanted")}
    mask = mask_from_strokes(view, rectangle=(100, 20, 140, 160), **strokes)
    np.testing.assert_array_equal(opened(answer), mask * 255)


@pytest.mark.parametrize(
    ("painted", "status", "told"),
    [
        ({}, 422, "nothing is marked"),
        ({"rectangle": [0, 0, 320, 240]}, 422, "leaves no background"),
        ({"rectangle": [0, 0, 3200, 240]}, 422, "leaves the picture of 320 x 240 px"),
        ({"rectangle": [1, 2, 3]}, 422, "rectangle"),
        ({"rectangle": "all"}, 422, "rectangle"),
        ({"wanted": [{"radius": 0, "points": [[1, 1]]}]}, 422, "radius"),
        ({"wanted": [{"radius": 2, "points": []}]}, 422, "points"),
        ({"wanted": [{"radius": 2, "points": [[1e9, 1]]}]}, 422, "points"),
        ({"wanted": [BRUSH], "also": 1}, 422, "also"),
        ([], 422, "the body"),
    ],
)
def test_what_cannot_be_painted(client, outline, painted, status, told):
    answer = client.post(f"/v1/outlines/{outline['id']}/mask", json=painted)
    assert answer.status_code == status and told in answer.json()["detail"], answer.text
    assert answer.headers["content-type"] == "application/problem+json" and "\n" not in answer.json()["detail"]


def test_pairs_that_are_none(served, client, raw_folder, rig):
    pair = pair_of(raw_folder)
    small = io.BytesIO()
    Image.new("RGB", (100, 80)).save(small, "PNG")
    cut = ("left.png", pair["left"][1][:-20])
    for files, data, told in (
        ({**pair, "left": ("s.png", small.getvalue())}, {"rig": rig}, "left is 100 x 80 px, right is 320 x 240 px"),
        ({**pair, "left": cut}, {"rig": rig}, "cut off"),
        (pair, {"rig": "0" * 32}, "there is no rig"),
        (pair, {}, "rig is missing"),
        (pair, {"rig": rig, "reference": "middle"}, "middle"),
    ):
        answer = client.post("/v1/outlines", files=files, data=data)
        assert answer.status_code == 422 and told in answer.json()["detail"], answer.text
        assert str(served.settings.data) not in answer.text
    assert not list(served.service.folders.uploads.iterdir())


def test_a_rig_whose_file_is_lost(served, client, raw_folder):
    rig = add_rig(client, raw_folder)
    served.service.folders.rig(rig).unlink()
    answer = client.post("/v1/outlines", files=pair_of(raw_folder), data={"rig": rig})
    assert answer.status_code == 422 and "rig.json" in answer.json()["detail"]
    assert "/" not in answer.json()["detail"], "where the service keeps its files is none of the client's business"


def test_nothing_of_another_client(served, raw_folder, rig, outline):
    with served.client(served.token_of("bob")) as bob:
        assert bob.get(outline["picture"]).status_code == 404
        assert bob.post(f"/v1/outlines/{outline['id']}/mask", json={"wanted": [BRUSH]}).status_code == 404
        assert bob.post("/v1/outlines", files=pair_of(raw_folder), data={"rig": rig}).status_code == 422
    with served.client("") as nobody:
        assert nobody.get(outline["picture"]).status_code == 401


def test_no_more_wait_than_can_be_served(served, client, outline, monkeypatch):
    monkeypatch.setattr("stereo_gpu.service.outlines.MOST_WAITING", 1)
    statuses = []

    def ask():
        with served.client() as other:
            answer = other.post(f"/v1/outlines/{outline['id']}/mask", json={"wanted": [BRUSH]})
            statuses.append((answer.status_code, answer.headers.get("retry-after")))

    threads = [threading.Thread(target=ask) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (200, None) in statuses and set(statuses) <= {(200, None), (503, "2")}
    assert (503, "2") in statuses
    assert client.post(f"/v1/outlines/{outline['id']}/mask", json={"wanted": [BRUSH]}).status_code == 200


def test_a_full_disk_is_told_as_such(raw_folder, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    for name in ("left.png", "right.png"):
        shutil.copy(raw_folder / name, tmp_path)
    monkeypatch.setattr("pathlib.Path.write_bytes", full)
    given = ("left.png", "right.png", raw_folder / "rig.json", "right")
    with pytest.raises(DiskFull, match="the disk is full"):  # 507 without the folder's name, where a route raises it
        do_task("view", tmp_path, given, backend=None)


def test_an_hour_later_it_is_gone(served, client, raw_folder, rig, monkeypatch):
    answer = client.post("/v1/outlines", files=pair_of(raw_folder), data={"rig": rig}).json()
    later = time.time() + 3601
    monkeypatch.setattr(served.service.desk, "_clock", lambda: later)
    assert client.get(answer["picture"]).status_code == 404
    fresh = client.post("/v1/outlines", files=pair_of(raw_folder), data={"rig": rig}).json()
    assert [folder.name for folder in served.service.folders.outlines.iterdir()] == [fresh["id"]]


def test_a_client_keeps_its_last_ones(served, raw_folder, monkeypatch):
    monkeypatch.setattr("stereo_gpu.service.outlines.MOST_EACH", 2)
    with served.client(served.token_of("carol")) as carol:
        own = {"rig": add_rig(carol, raw_folder)}
        made = [carol.post("/v1/outlines", files=pair_of(raw_folder), data=own).json()["id"] for _ in range(4)]
        kept = [carol.get(f"/v1/outlines/{id}/picture").status_code for id in made]
    assert kept == [404, 404, 200, 200]
