"""The demo at a quarter of its pixels: the real chain from picture files, and honest figures."""

import json
import re

import pytest

from stereo_gpu.demo import run_demo
from stereo_gpu.errors import BackendError, InputError
from stereo_gpu.rig import Rig
from stereo_gpu.scene import build_scene
from stereo_gpu.scene_truth import measure_calibration

SIZE = (320, 240)


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    out = tmp_path_factory.mktemp("demo") / "out"
    return out, list(run_demo(out, size=SIZE))


def test_leaves_pictures_rig_and_model(shown):
    out, lines = shown
    names = {path.name for path in out.iterdir()}
    assert {"pictures", "rig.json", "model.glb", "report.html", "result.json"} <= names
    assert len(list((out / "pictures").iterdir())) == 32
    assert not list(out.rglob("*.part"))
    assert str(out / "report.html") in lines[-1]
    assert json.loads((out / "result.json").read_text())["inputs"]["left"]["name"] == "left.png"


def test_the_calibration_is_that_of_the_true_cameras(shown):
    out, lines = shown
    error = measure_calibration(build_scene(SIZE), Rig.load(out / "rig.json"))
    assert error["rms_px"] < 0.1
    (told,) = (line for line in lines if "against the true cameras" in line)
    assert f"{error['rms_px']:.3f} px rms" in told
    assert any("up to one rigid motion" in line for line in lines)


def test_the_surface_is_near_the_true_one(shown):
    _, lines = shown
    (told,) = (line for line in lines if "against the true surface" in line)
    covered, median = map(float, re.search(r"([\d.]+)% of the objects .* error ([\d.]+) % \(median", told).groups())
    assert covered > 95
    assert median < 0.4  # half the resolution of the demo, so twice its bar of 0.2 %


def test_nothing_is_begun_that_cannot_end(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is a file"):
        next(run_demo(tmp_path / "file" / "out", size=SIZE))
    with pytest.raises(BackendError, match="abacus"):
        next(run_demo(tmp_path / "out", backend="abacus", size=SIZE))
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
