import dataclasses
import json

import numpy as np
import pytest

from stereo_gpu.deviations import CameraDeviations, Deviations
from stereo_gpu.errors import InputError
from stereo_gpu.rig import Camera, Rig


def deviations(coefficients=5):
    lens = np.arange(coefficients) / 7
    return Deviations(
        left=CameraDeviations(fx=1 / 3, fy=0.2, cx=0.1, cy=1e-17, distortion=lens),
        right=CameraDeviations(fx=1 / 7, fy=0.3, cx=0.4, cy=0.5, distortion=lens / 3),
        om=np.array([0.001, 0.1 + 0.2, 1e-300]),
        T=np.array([0.1, 1 / 9, 3.0]),
    )


@pytest.fixture
def rig():
    camera = Camera(np.diag([500.0, 500.0, 1.0]), np.zeros(5), (640, 480))
    return Rig(camera, camera, np.eye(3), np.array([-60.0, 0, 0]), deviations=deviations())


def test_a_round_trip_keeps_every_digit(rig, tmp_path):
    back = Rig.load(rig.save(tmp_path / "rig.json")).deviations
    for one, other in ((rig.deviations.left, back.left), (rig.deviations.right, back.right)):
        assert (one.fx, one.fy, one.cx, one.cy) == (other.fx, other.fy, other.cx, other.cy)
        np.testing.assert_array_equal(one.distortion, other.distortion)
    np.testing.assert_array_equal(back.om, rig.deviations.om)
    np.testing.assert_array_equal(back.T, rig.deviations.T)


def test_files_without_deviations_still_load(rig, tmp_path):
    path = dataclasses.replace(rig, deviations=None).save(tmp_path / "rig.json")
    assert "deviations" not in json.loads(path.read_text())
    assert Rig.load(path).deviations is None


@pytest.mark.parametrize(
    ("where", "value", "told"),
    [
        ((), 5, "deviations is 5"),
        (("left",), [], "deviations.left is"),
        (("left", "fx"), -1, "deviation of fx is -1"),
        (("left", "fx"), "1", "deviation of fx is '1'"),
        (("right", "distortion"), [1, 2, 3, 4], "deviations.right.distortion has 4 numbers, the lens has 5"),
        (("right", "distortion"), [[1], [2, 3]], "deviation of distortion|distortion has shape"),
        (("right", "distortion"), [], "distortion has shape"),
        (("om",), [1, 2], "deviation of om is"),
        (("T",), [1, 2, float("nan")], "must be finite"),
        (("T",), [True, False, True], "deviation of T is"),
        (("T",), None, "deviation of T is None"),
    ],
)
def test_nonsense_is_refused_in_one_line(rig, tmp_path, where, value, told):
    path = rig.save(tmp_path / "rig.json")
    content = json.loads(path.read_text())
    part = content
    for key in ("deviations", *where)[:-1]:
        part = part[key]
    part[("deviations", *where)[-1]] = value
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=told) as caught:
        Rig.load(path)
    assert "\n" not in str(caught.value)


def test_a_missing_part_is_named(rig, tmp_path):
    path = rig.save(tmp_path / "rig.json")
    content = json.loads(path.read_text())
    del content["deviations"]["right"]["cy"]
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"deviations\.right\.cy is missing"):
        Rig.load(path)


def test_they_must_fit_the_lenses(rig):
    with pytest.raises(InputError, match="has 8 numbers, the lens has 5"):
        dataclasses.replace(rig, deviations=deviations(8))
    with pytest.raises(InputError, match="give Deviations, or None"):
        dataclasses.replace(rig, deviations={"om": 1})
