import json
import math

import cv2
import numpy as np
import pytest

from stereo_gpu.errors import InputError
from stereo_gpu.rig import LARGEST_FILE, Camera, Rig, ViewError


def make_rig(coefficients=5):
    random = np.random.default_rng(3)
    matrix = np.array([[500 / 3, 0, 321.1], [0, 500 / 7, 239.7], [0, 0, 1]])
    lens = random.normal(size=coefficients) / 3
    return Rig(
        left=Camera(matrix, lens, (641, 480), 0.1),
        right=Camera(matrix + np.diag([math.pi, math.e, 0]), lens / 3, (640, 480), 0.2),
        R=cv2.Rodrigues(np.array([0.1, -0.2, 1 / 3]))[0],
        T=np.array([-100 / 3, 1e-17, 0.1 + 0.2]),
        rms_px=1 / 7,
        epipolar_rms_px=1 / 9,
        views=(
            ViewError("left 1", "right 1", 0.1, 0.2, 0.3),
            ViewError("l.png", "r.png", used=False, reason='no "board"\nfound'),
        ),
    )


@pytest.fixture
def rig_file(tmp_path):
    return make_rig().save(tmp_path / "rig.json")


@pytest.mark.parametrize("coefficients", [5, 8, 12])
def test_a_round_trip_keeps_every_digit(tmp_path, coefficients):
    rig = make_rig(coefficients)
    back = Rig.load(rig.save(tmp_path / "rig.json"))
    for one, other in ((rig.left, back.left), (rig.right, back.right)):
        np.testing.assert_array_equal(one.matrix, other.matrix)
        np.testing.assert_array_equal(one.distortion, other.distortion)
        assert (one.size, one.rms_px) == (other.size, other.rms_px)
    np.testing.assert_array_equal(rig.R, back.R)
    np.testing.assert_array_equal(rig.T, back.T)
    assert (rig.rms_px, rig.epipolar_rms_px, rig.unit) == (back.rms_px, back.epipolar_rms_px, back.unit)
    assert rig.views == back.views


def test_the_baseline_is_the_length_of_t():
    assert make_rig().baseline == pytest.approx(math.hypot(100 / 3, 0.3))


def test_a_rig_cannot_be_changed_by_accident():
    with pytest.raises(ValueError, match="read-only"):
        make_rig().T[0] = 0


NONSENSE = [
    (("R",), [[1, 0, 0], [0, 1, 0], [0, 0, 1.1]], "R is no rotation"),
    (("R",), [[1, 0, 0], [0, 1, 0], [0, 0, -1]], "mirrors"),
    (("R",), [[1, 0, 0], [0, 1, 0]], r"R has shape \(2, 3\)"),
    (("R",), [[1, 0], [0, 1, 0], [0]], "R is"),
    (("R",), [[1e200, 1e200, 0], [1e200, -1e200, 0], [0, 0, 1]], "R is no rotation"),
    (("T",), [0, 0, 0], "one point"),
    (("T",), [math.nan, 0, 0], "nan: it must be finite"),
    (("T",), [math.inf, 0, 0], "inf: it must be finite"),
    (("T",), [10**400, 0, 0], "T has"),
    (("T",), "far", "T has shape"),
    (("T",), [True, False, True], "T has"),
    (("left", "matrix", 0, 0), 0, r"left\.matrix has focal length fx = 0"),
    (("right", "matrix", 1, 1), -500, r"right\.matrix has focal length fy = -500"),
    (("right", "matrix", 2, 2), 2, "must read fx s cx"),
    (("right", "matrix", 0, 1), 2, "skew"),
    (("left", "distortion"), [0.1] * 4, "5, 8 or 12"),
    (("left", "distortion"), None, "5, 8 or 12"),
    (("left", "distortion"), [0.1, [0.2], 0, 0, 0], "5, 8 or 12"),
    (("left", "distortion", 2), None, r"left\.distortion has"),
    (("left", "size"), [0, 480], "size is"),
    (("left", "size"), [640.5, 480], "size is"),
    (("left", "size"), [640, 480, 3], "size has shape"),
    (("left", "size"), [10**7, 480], "size is"),
    (("left",), 5, "left is 5"),
    (("rms_px",), -1, "rms_px is -1"),
    (("rms_px",), "good", "rms_px has"),
    (("unit",), "", "unit is"),
    (("unit",), 5, "unit is 5"),
    (("views",), {}, "views is"),
    (("views", 1), 7, r"views\[1\] is 7"),
    (("views", 0, "used"), 1, r"views\[0\]\.used is 1"),
    (("views", 0, "left_px"), -1, r"views\[0\]\.left_px is -1"),
    (("format",), "other", "format is 'other'"),
    (("version",), 99, "version is 99"),
]


@pytest.mark.parametrize(("where", "value", "told"), NONSENSE)
def test_nonsense_is_refused_in_one_line(rig_file, where, value, told):
    content = json.loads(rig_file.read_text())
    part = content
    for key in where[:-1]:
        part = part[key]
    part[where[-1]] = value
    rig_file.write_text(json.dumps(content))
    with pytest.raises(InputError, match=told) as caught:
        Rig.load(rig_file)
    assert str(caught.value).startswith(str(rig_file))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < len(str(rig_file)) + 250


@pytest.mark.parametrize("field", ["unit", "left", "right", "R", "T", "rms_px", "epipolar_rms_px", "views"])
def test_a_missing_field_is_named(rig_file, field):
    content = json.loads(rig_file.read_text())
    del content[field]
    rig_file.write_text(json.dumps(content))
    with pytest.raises(InputError, match=f"{field} is missing"):
        Rig.load(rig_file)


def test_a_file_cut_off_anywhere_is_refused(rig_file):
    data = rig_file.read_bytes().rstrip()
    for length in range(0, len(data), 97):
        rig_file.write_bytes(data[:length])
        with pytest.raises(InputError, match="not JSON, or is cut off"):
            Rig.load(rig_file)


@pytest.mark.parametrize("data", [b"\xff\xfe\x00", b"[" * 100_000, b"[]", b"null", b"%YAML:1.0", b"\x89PNG\r\n"])
def test_another_kind_of_file_is_refused(rig_file, data):
    rig_file.write_bytes(data)
    with pytest.raises(InputError, match=r"rig\.json") as caught:
        Rig.load(rig_file)
    assert "\n" not in str(caught.value)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        Rig.load(tmp_path / "none.json")
    with pytest.raises(InputError, match="is a folder"):
        Rig.load(tmp_path)
    with (tmp_path / "huge.json").open("wb") as stream:
        stream.truncate(LARGEST_FILE + 1)
    with pytest.raises(InputError, match="larger than 16 MiB"):
        Rig.load(tmp_path / "huge.json")
