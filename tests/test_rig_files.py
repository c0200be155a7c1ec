"""Calibration files of other programs: what comes back, what every digit means, and what is refused."""

import io
import json
import logging
import zlib
from dataclasses import replace

import cv2
import numpy as np
import pytest
from calibration_files import KITTI_ODOMETRY, KITTI_RAW, MIDDLEBURY, make_rig, same
from scipy.io import loadmat, savemat

import stereo_gpu as sg
from stereo_gpu.cli import main
from stereo_gpu.errors import InputError
from stereo_gpu.rig_files.load import load_rig_for
from stereo_gpu.rig_files.source import LARGEST_FILE

FILES = [("rig.json", None), ("rig.yml", None), ("rig.xml", None), ("rig.mat", None), ("ros", "ros")]


def refused(told, *paths, **options):
    with pytest.raises(InputError, match=told) as caught:
        sg.load_rig(*paths, **options)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 200 + sum(len(str(path)) for path in paths)
    return str(caught.value)


def put(folder, name, content):
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def mat(folder, content, **options):
    path = folder / "Calib_Results_stereo.mat"
    savemat(path, content, **options)
    return path


@pytest.fixture
def toolbox():
    """The variables of the toolbox's file."""
    rig = make_rig()
    content = {"nx": 640.0, "ny": 480.0, "om": cv2.Rodrigues(rig.R)[0], "R": rig.R, "T": rig.T.reshape(3, 1)}
    for side, camera in (("left", rig.left), ("right", rig.right)):
        content[f"fc_{side}"] = np.diag(camera.matrix)[:2].reshape(2, 1)
        content[f"cc_{side}"] = camera.matrix[:2, 2:]
        content[f"kc_{side}"] = camera.distortion.reshape(5, 1)
        content[f"alpha_c_{side}"] = 0.0
        content[f"KK_{side}"] = camera.matrix
    return content


# What was written comes back.


@pytest.mark.parametrize("unit", ["mm", "m", "in"])
@pytest.mark.parametrize(("name", "kind"), FILES)
def test_a_round_trip_keeps_every_digit(tmp_path, name, kind, unit):
    rig = replace(make_rig(), unit=unit)
    files = sg.save_rig(rig, tmp_path / name, format=kind)
    assert all(file.is_file() for file in files)
    assert same(sg.load_rig(tmp_path / name), rig)
    assert same(sg.load_rig(*files), rig)


@pytest.mark.parametrize(("name", "coefficients"), [("rig.yml", 8), ("rig.yml", 12), ("rig.xml", 12), ("ros", 8)])
def test_longer_lenses_too(tmp_path, name, coefficients):
    rig = make_rig(coefficients)
    sg.save_rig(rig, tmp_path / name, format="ros" if name == "ros" else None)
    assert same(sg.load_rig(tmp_path / name), rig)


@pytest.mark.parametrize("name", ["rig.yml", "rig.xml"])
def test_errors_and_unlike_sizes_stay_in_opencvs_files(tmp_path, name):
    rig = make_rig()
    rig = replace(rig, right=replace(rig.right, size=(648, 486)))
    back = sg.load_rig(*sg.save_rig(rig, tmp_path / name))
    assert same(back, rig)
    assert (back.rms_px, back.epipolar_rms_px) == (rig.rms_px, rig.epipolar_rms_px)
    assert (back.left.rms_px, back.right.rms_px) == (rig.left.rms_px, rig.right.rms_px)


@pytest.mark.parametrize("name", ["rig.yml", "rig.xml"])
def test_opencv_reads_the_same_bits(tmp_path, name):
    rig = make_rig(12)
    sg.save_rig(rig, tmp_path / name)
    storage = cv2.FileStorage(str(tmp_path / name), cv2.FILE_STORAGE_READ)
    for key, value in (("M1", rig.left.matrix), ("D2", rig.right.distortion), ("R", rig.R), ("T", rig.T)):
        np.testing.assert_array_equal(storage.getNode(key).mat().ravel(), value.ravel())
    assert storage.getNode("image_width").real() == 640
    assert storage.getNode("unit").string() == "mm"


def test_deviations_stay_in_the_toolboxs_file(tmp_path):
    rig = make_rig(deviations=True)
    path = sg.save_rig(rig, tmp_path / "rig.mat")[0]
    np.testing.assert_allclose(loadmat(path)["T_error"].ravel(), 3 * rig.deviations.T)  # three of them, as it counts
    back = sg.load_rig(path).deviations
    np.testing.assert_allclose(back.T, rig.deviations.T, rtol=1e-15)
    np.testing.assert_allclose(back.om, rig.deviations.om, rtol=1e-15)
    np.testing.assert_allclose(back.left.distortion, rig.deviations.left.distortion, rtol=1e-15)
    assert back.right.cy == pytest.approx(rig.deviations.right.cy, rel=1e-15)
    metres = sg.load_rig(path, unit="m").deviations
    np.testing.assert_allclose(metres.T, rig.deviations.T / 1000, rtol=1e-14)


# The issue's own rigs.


def test_the_published_rig_of_the_cup(data):
    path = data / "rigs" / "cup" / "published_opencv.yml"
    refused("add --size 640x480", path)
    rig = sg.load_rig(path, size=(640, 480))
    np.testing.assert_array_equal(rig.T, [-49.301779325903709, 0.043624039985762808, -0.14109363238576378])
    assert rig.left.matrix[0, 0] == 387.12459035707548
    assert rig.right.distortion[4] == -0.012364133602136736
    assert (rig.left.rms_px, rig.right.rms_px, rig.unit) == (0.19282812855544398, 0.26343174434579092, "mm")


def test_board_10x7_by_way_of_the_toolboxs_layout(data, board_calibration, tmp_path):
    rig = board_calibration.rig
    back = sg.load_rig(*sg.save_rig(rig, tmp_path / "Calib_Results_stereo.mat"))
    assert same(back, rig)
    published = json.loads((data / "calibration" / "board_10x7" / "published.json").read_text())
    assert (np.abs(back.T - published["T_mm"]) <= 2 * np.array(published["T_uncertainty_mm"])).all()
    om = cv2.Rodrigues(back.R)[0].ravel()
    assert (np.abs(om - published["om_rad"]) <= 2 * np.array(published["om_uncertainty_rad"])).all()


def test_the_published_numbers_in_the_toolboxs_layout(data, toolbox, tmp_path):
    published = json.loads((data / "calibration" / "board_10x7" / "published.json").read_text())
    toolbox |= {"om": np.reshape(published["om_rad"], (3, 1)), "T": np.reshape(published["T_mm"], (3, 1))}
    del toolbox["R"]  # it follows from om
    toolbox |= {
        f"{name}_{side}_error": np.full((count, 1), 0.3)
        for name, count in (("fc", 2), ("cc", 2), ("kc", 5))
        for side in ("left", "right")
    }
    toolbox["om_error"] = np.reshape(published["om_uncertainty_rad"], (3, 1))
    toolbox["T_error"] = np.reshape(published["T_uncertainty_mm"], (3, 1))
    rig = sg.load_rig(mat(tmp_path, toolbox))
    np.testing.assert_array_equal(rig.T, published["T_mm"])
    np.testing.assert_allclose(cv2.Rodrigues(rig.R)[0].ravel(), published["om_rad"], atol=1e-12)
    np.testing.assert_allclose(3 * rig.deviations.T, published["T_uncertainty_mm"], rtol=1e-12)
    np.testing.assert_allclose(3 * rig.deviations.om, published["om_uncertainty_rad"], rtol=1e-12)
    assert rig.left.size == (640, 480)


# What other programs write.


def opencv_file(path, content):
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in content.items():
        storage.write(name, value)
    storage.release()
    return path


@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
@pytest.mark.parametrize(
    "names",
    [
        "M1 D1 M2 D2 R T",
        "K1 D1 K2 D2 R T",
        "cameraMatrix1 distCoeffs1 cameraMatrix2 distCoeffs2 R T",
        "camera_matrix_left dist_coeffs_left camera_matrix_right dist_coeffs_right rotation translation",
        "left_camera_matrix left_distortion right_camera_matrix right_distortion R T",
        "cameraMatrixL distCoeffsL cameraMatrixR distCoeffsR rotationMatrix translationVector",
        "K0 dist0 K1 dist1 R t",
    ],
)
def test_opencvs_own_files_under_their_usual_names(tmp_path, names, suffix):
    rig = make_rig()
    values = [rig.left.matrix, rig.left.distortion.reshape(1, 5), rig.right.matrix, rig.right.distortion.reshape(1, 5)]
    content = dict(zip(names.split(), [*values, rig.R, rig.T.reshape(3, 1)], strict=True))
    path = opencv_file(tmp_path / f"rig.{suffix}", content)
    back = sg.load_rig(path, size=(640, 480))
    for value, twin in ((rig.left.matrix, back.left.matrix), (rig.right.matrix, back.right.matrix), (rig.R, back.R)):
        np.testing.assert_array_equal(value, twin)
    np.testing.assert_array_equal(rig.T, back.T)
    np.testing.assert_array_equal(rig.right.distortion, back.right.distortion)
    assert back.unit == "mm"
    refused("add --size 640x480", path)


def test_plain_json_under_opencvs_names(tmp_path):
    rig = make_rig()
    values = (rig.left.matrix, rig.left.distortion, rig.right.matrix, rig.right.distortion, rig.R, rig.T)
    content = {name: value.tolist() for name, value in zip(("K1", "D1", "K2", "D2", "R", "T"), values, strict=True)}
    back = sg.load_rig(put(tmp_path, "rig.json", json.dumps(content)), size=(640, 480))
    np.testing.assert_array_equal(back.T, rig.T)
    np.testing.assert_array_equal(back.left.distortion, rig.left.distortion)
    refused("does not hold two cameras", put(tmp_path, "rig.json", '{"left": {}, "right": {}}'))


def test_two_files_as_the_stereo_calib_sample_writes(tmp_path):
    rig = make_rig(8)
    long = [np.append(camera.distortion, np.zeros(6)).reshape(1, 14) for camera in (rig.left, rig.right)]
    opencv_file(
        tmp_path / "intrinsics.yml", {"M1": rig.left.matrix, "D1": long[0], "M2": rig.right.matrix, "D2": long[1]}
    )
    extra = {"R1": np.eye(3), "P2": np.ones((3, 4)), "Q": np.eye(4)}
    opencv_file(tmp_path / "extrinsics.yml", {"R": rig.R, "T": rig.T.reshape(3, 1), **extra})
    for paths in ([tmp_path], [tmp_path / "intrinsics.yml", tmp_path / "extrinsics.yml"]):
        back = sg.load_rig(*paths, size=(640, 480))
        np.testing.assert_array_equal(back.T, rig.T)
        np.testing.assert_array_equal(back.left.distortion, np.append(rig.left.distortion, np.zeros(4)))
    refused("has no R", tmp_path / "intrinsics.yml", size=(640, 480))


def test_ros_without_our_own_entry_keeps_r_and_t_but_for_rounding(tmp_path):
    rig = make_rig()
    files = sg.save_rig(rig, tmp_path / "ros", format="ros")
    files[1].write_text(files[1].read_text().partition("stereo_gpu:")[0])
    back = sg.load_rig(*files)
    assert back.unit == "m"
    np.testing.assert_array_equal(back.left.matrix, rig.left.matrix)
    np.testing.assert_array_equal(back.right.distortion, rig.right.distortion)
    np.testing.assert_allclose(back.R, rig.R, atol=1e-14)
    np.testing.assert_allclose(1000 * back.T, rig.T, atol=1e-12)
    assert sg.load_rig(*files, unit="mm").baseline == pytest.approx(rig.baseline, rel=1e-13)


def test_ros_entry_of_ours_that_is_out_of_date_does_not_count(tmp_path, caplog):
    files = sg.save_rig(make_rig(), tmp_path / "ros", format="ros")
    text = files[1].read_text()
    before = sg.load_rig(*files)
    moved = text.replace("data: [-33.3", "data: [-34.3")
    assert moved != text
    files[1].write_text(moved)
    with caplog.at_level(logging.WARNING):
        back = sg.load_rig(*files)
    assert "does not agree" in caplog.text
    np.testing.assert_allclose(1000 * back.T, before.T, atol=1e-12)


def test_rectifying_with_ros_numbers_gives_ros_projections(tmp_path):
    """What camera_calibration of image_pipeline would write: P[0, 3] = -fx B in metres, rows that correspond."""
    rig = make_rig()
    right = (sg.save_rig(rig, tmp_path, format="ros")[1]).read_text()
    projection = right.partition("projection_matrix")[2].partition("[")[2].partition("]")[0]
    numbers = [float(part) for part in projection.split(",")]
    assert numbers[3] == pytest.approx(-numbers[0] * rig.baseline / 1000, rel=1e-9)


def test_middlebury(tmp_path):
    rig = sg.load_rig(put(tmp_path, "calib.txt", MIDDLEBURY))
    assert (rig.left.size, rig.unit) == ((2964, 1988), "mm")
    np.testing.assert_array_equal(rig.T, [-193.001, 0, 0])
    np.testing.assert_array_equal(rig.R, np.eye(3))
    assert (rig.left.matrix[0, 2], rig.right.matrix[0, 2]) == (1176.728, 1307.839)
    assert not rig.left.distortion.any()


def test_kitti_odometry(tmp_path):
    path = put(tmp_path, "calib.txt", KITTI_ODOMETRY)
    refused("add --size", path)
    rig = sg.load_rig(path, size=(1241, 376))
    assert rig.unit == "m"
    assert rig.baseline == pytest.approx(0.5333, abs=1e-4)  # the pair in colour
    grey = sg.load_rig(path, size=(1241, 376), cameras=(0, 1))
    np.testing.assert_allclose(grey.T, [-386.1448 / 718.856, 0, 0], rtol=1e-14)
    assert sg.load_rig(path, size=(1241, 376), cameras=(0, 1), unit="mm").baseline == pytest.approx(537.166, abs=1e-3)


def test_kitti_raw_knows_both_kinds_of_its_pictures(tmp_path):
    path = put(tmp_path, "calib_cam_to_cam.txt", KITTI_RAW)
    raw = sg.load_rig(path)
    assert (raw.left.size, raw.left.matrix[0, 0]) == ((1392, 512), 984.2439)
    np.testing.assert_allclose(raw.T, [-0.537, 4.822061e-03, -1.252488e-02], atol=1e-15)
    rectified = sg.load_rig(path, size=(1242, 375))
    assert rectified.left.matrix[0, 0] == 721.5377
    np.testing.assert_allclose(rectified.T, [-387.5744 / 721.5377, 0, 0], rtol=1e-14)
    # Rectifying the raw cameras here gives the geometry that KITTI's authors rectified to.
    turns = cv2.stereoRectify(
        raw.left.matrix,
        raw.left.distortion,
        raw.right.matrix,
        raw.right.distortion,
        raw.left.size,
        raw.R,
        raw.T.reshape(3, 1),
    )
    assert -turns[3][0, 3] / turns[3][0, 0] == pytest.approx(rectified.baseline, abs=2e-4)


def test_a_rounded_rotation_becomes_the_nearest_one(tmp_path, caplog):
    rig = make_rig()
    path = sg.save_rig(rig, tmp_path / "rig.yml")[0]
    rounded = np.round(rig.R, 4)
    path.write_text(
        path.read_text().replace(
            ", ".join(map(repr, rig.R.ravel().tolist())), ", ".join(map(repr, rounded.ravel().tolist()))
        )
    )
    with caplog.at_level(logging.WARNING):
        back = sg.load_rig(path)
    assert "is rounded" in caplog.text
    np.testing.assert_allclose(back.R @ back.R.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(back.R, rig.R, atol=1e-4)


# What is refused, in one line each.


def swap(text, old, new):
    assert old in text
    return text.replace(old, new, 1)


OPENCV = [
    ("rows: 3", "rows: 4", "M1 has 4 x 3"),
    ("0.0, 321.1", ".Nan, 321.1", "M1 holds .Nan: it must be finite"),
    ("0.0, 321.1", ".Inf, 321.1", "M1 holds .Inf"),
    ("0.0, 321.1", "1e999, 321.1", "M1 holds 1e999"),
    ("0.0, 321.1", "5.0, 321.1", "left camera: matrix has skew"),
    ("0.0, 321.1", "1_0, 321.1", "M1 holds '1_0': it must be a number"),
    ("321.1", "321.1, 7", "M1 has 3 x 3 rows and columns, 10 numbers"),
    ("321.1", "1e9", "principal point at"),
    ("321.1", "[321.1, {}]", "M1 holds"),
    ("533.3333333333334", "0.0", "focal length fx = 0"),
    ("533.3333333333334", "-533.0", "focal length fx = -533"),
    ("533.3333333333334", "1e-9", "left camera has fx = 1e-09"),
    ("533.3333333333334", "1e20", r"left camera has fx = 1e\+20"),
    ("image_width: 640", "image_width: -640", "size is"),
    ("image_width: 640", "image_width: 640.5", "whole number"),
    ("image_width: 640", "image_width: 1e29", "whole number"),
    ("image_width: 640", "image_width: 1e300", "image_width holds 1e300: no calibration has"),
    ("-33.333333333333336, 1e-17, 0.30000000000000004", "0.0, 0.0, 0.0", "cameras stand"),
    ("-33.333333333333336", "-1e20", "cameras stand"),
    ("-33.333333333333336", "-1e300", "T holds -1e300: no calibration has a number above"),
    ("-33.333333333333336", "33.333333333333336", "to the left of the left one: exchange left and right"),
    ("M2:", "M9:", "does not hold two cameras"),
    ("D2:", "D9:", "has no M|has no D"),
    ("T: !!", "T9: !!", "has no T"),
    ("unit: mm", "R: 5", "stands twice"),
    ("unit: mm", "unit: &a mm\nx: *a", "alias"),
    ("unit: mm", "? [a]\n: b", "as a name"),
    ("unit: mm", "x: " + "[" * 40 + "]" * 40, "nested more than 32"),
    ("unit: mm", "x: [", "no calibration, or cut off"),
    ("cols: 5", "cols: five", "must be a number"),
    ("dt: d\n   data", "dt: d\n   date", "M1 has no data|does not hold two"),
]


@pytest.mark.parametrize(("old", "new", "told"), OPENCV)
def test_nonsense_in_opencvs_yaml(tmp_path, old, new, told):
    path = sg.save_rig(make_rig(), tmp_path / "rig.yml")[0]
    text = path.read_text()
    text = text.replace("1.0e-17", "1e-17")
    message = refused(told, put(tmp_path, "rig.yml", swap(text, old, new)))
    assert message.startswith(str(path))


def test_a_rotation_that_is_none(tmp_path):
    path = sg.save_rig(make_rig(), tmp_path / "rig.yml")[0]
    text = path.read_text()
    numbers = text.partition("R: ")[2].partition("[")[2].partition("]")[0]
    for values, told in (
        (np.ones(9), "off by"),
        (np.diag([1, 1, -1]).ravel(), "mirrors"),
        (np.full(9, 1e20), "off by"),
    ):
        put(tmp_path, "rig.yml", swap(text, numbers, ", ".join(map(str, map(float, values)))))
        refused(f"R is no rotation: it .*{told}", path)


BOMB = """<?xml version="1.0"?>
<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>
<opencv_storage><M1>&b;</M1></opencv_storage>"""
FOREIGN = [
    (b"", "is empty"),
    (b" \n\t", "is empty"),
    (b"\0" * 100, "binary"),
    (b"\x89PNG\r\n\x1a\n" + b"\0" * 50, "binary"),
    (b"[" * 100_000, "rig"),
    (b"{" * 100_000, "rig"),
    (b"a: " + b"[" * 100_000, "nested more than 32"),
    (b"- " * 100_000, "nested more than 32"),
    (b"<a>" * 100_000, "nested more than 32"),
    (b"<a>1", "not XML, or cut off"),
    (b"<a/>", "no named values"),
    (b"<a><_>1</_><b>2</b></a>", "items and b"),
    (BOMB.encode(), "document type"),
    (BOMB.encode("utf-16"), "document type"),
    (b'<?xml version="1.0" encoding="hex"?><a/>', "text|XML"),
    (b'<?xml version="1.0" encoding="none-such"?><a/>', "text|XML"),
    (b'{"M1": "opencv-matrix", "a": ' + b"[" * 50 + b"]" * 50 + b"}", "nested more than 32"),
    (b'{"type_id": "opencv-matrix", "a": 1, "a": 2}', "a stands twice"),
    (b'{"type_id": "opencv-matrix", "a": ', "not JSON, or cut off"),
    (b'{"type_id": "opencv-matrix", "a": [true, null, NaN]}', "does not hold two cameras"),
    (b'{"format": "stereo-gpu rig"}', "version"),
    (b"%YAML:1.0\n---\n", "no calibration|no content|no named values"),
    (b"hello", "no named values"),
    (b"a: 1" + b"\n" * 1_000_000, "does not hold two cameras"),  # a pattern may not look at each line's whole rest
    (b"\xff\xfeabc", "no calibration"),
    (b"cam0=[1 0 0]\nwhat is this", "line 2"),
    (b"cam0=[1 0 0]\ncam0=[2 0 0]", "cam0 stands twice"),
    (b"P0: 1 2 3\nP1: \xff", "not text"),
    (b"P0: 1 2 3\nP1: 1 2 3\n", "P0 has 3 numbers"),
    (b"P0: 1 2 3\n", "no P2 and P3 or P0 and P1"),
    (b"K_00: 1\nK_01: 2\n", "has no D_00|K_00"),
    (b"MATLAB 5.0", "no MATLAB 5 file"),
    (b"MATLAB 7.3 MAT-file" + b" " * 200, "save -v7"),
    (b"\x89HDF\r\n\x1a\n" + b"\0" * 200, "save -v7"),
]


@pytest.mark.parametrize(("content", "told"), FOREIGN)
def test_files_that_are_no_calibration(tmp_path, content, told):
    refused(told, put(tmp_path, "rig.yml", content), size=(640, 480))


MIDDLEBURY_NONSENSE = [
    ("doffs=131.111", "doffs=13.1", "doffs is 13.1"),
    ("baseline=193.001", "baseline=-193", "above zero"),
    ("baseline=193.001", "baseline=nan", "finite"),
    ("width=2964", "width=2964.5", "whole number"),
    ("width=2964", "", "has no width"),
    ("cam1=[3997.684", "cam1=[0", "focal length fx = 0"),
    ("; 0 0 1]", "; 0 0]", "cam0 has 8"),
]


@pytest.mark.parametrize(("old", "new", "told"), MIDDLEBURY_NONSENSE)
def test_nonsense_in_middleburys_file(tmp_path, old, new, told):
    refused(told, put(tmp_path, "calib.txt", swap(MIDDLEBURY, old, new)))


def test_nonsense_in_kittis_files(tmp_path):
    size = (1241, 376)
    refused("P2 must read", put(tmp_path, "a.txt", swap(KITTI_ODOMETRY, "P2: 7.1", "P2: -7.1")), size=size)
    refused("stands twice", put(tmp_path, "a.txt", swap(KITTI_ODOMETRY, "P3:", "P2:")), size=size)
    refused("R_01 is no rotation", put(tmp_path, "a.txt", swap(KITTI_RAW, "R_01: 9.99", "R_01: 1.99")))
    refused("whole number", put(tmp_path, "a.txt", swap(KITTI_RAW, "S_00: 1.392000e+03", "S_00: 1.3925e-01")))
    path = put(tmp_path, "a.txt", KITTI_RAW)
    refused("K_02 and K_03", path, cameras=(2, 3))
    refused("exchange left and right", put(tmp_path, "b.txt", KITTI_ODOMETRY), size=size, cameras=(3, 2))
    refused("1392 x 512 px, not of 640 x 480", path, size=(640, 480))


TOOLBOX_NONSENSE = [
    ({"alpha_c_left": 0.01}, "alpha_c_left is 0.01: only cameras without skew"),
    ({"fc_left": np.array([0.0, 500])}, "focal length fx = 0"),
    ({"fc_left": np.array([np.nan, 500])}, "fc_left has a value of nan"),
    ({"fc_left": np.arange(3.0)}, "fc_left has 1 x 3 numbers"),
    ({"fc_left": "text"}, "fc_left is a text"),
    ({"fc_left": {"a": 1}}, "fc_left is a struct"),
    ({"fc_left": np.array([1, "a"], dtype=object)}, "fc_left is a cell"),
    ({"fc_left": np.array([1 + 1j, 2])}, "fc_left is a complex matrix"),
    ({"fc_left": np.zeros((2, 0))}, "fc_left has 2 x 0 numbers"),
    ({"T": np.zeros(3)}, "cameras stand at one point"),
    ({"om": np.full(3, 50.0)}, "om is .*: a rotation vector"),
    ({"om": np.array([0.5, 0, 0])}, "R is another rotation than om"),
    ({"nx": -640.0}, "size is"),
    ({"nx": 640.5}, "whole number"),
    ({"kc_right": np.zeros(6)}, "kc_right has"),
    ({"T": None}, "it has no T"),
]


@pytest.mark.parametrize(("change", "told"), TOOLBOX_NONSENSE)
def test_nonsense_in_the_toolboxs_file(tmp_path, toolbox, change, told):
    content = {name: value for name, value in (toolbox | change).items() if value is not None}
    refused(told, mat(tmp_path, content))


def test_the_toolboxs_other_variables_do_no_harm(tmp_path, toolbox, caplog):
    more = {"X_left_1": np.ones((3, 54)), "history": np.array(["a", 1], dtype=object), "param": np.zeros(100_000)}
    older = {"kc_left": toolbox["kc_left"][:4] * 0, "alpha_c_right": 1e-7}
    rig = sg.load_rig(mat(tmp_path, toolbox | more | older, do_compression=True))
    np.testing.assert_array_equal(rig.left.distortion, np.zeros(5))
    assert "taken as 0" in caplog.text
    del toolbox["nx"], toolbox["ny"], toolbox["om"]
    path = mat(tmp_path, toolbox)
    refused("add --size", path)
    assert sg.load_rig(path, size=(640, 480)).left.size == (640, 480)


def element(content):
    """A variable of a file of zeros' kind, as its bytes."""
    stream = io.BytesIO()
    savemat(stream, content)
    return stream.getvalue()[128:]


def test_a_toolboxs_file_that_inflates_to_gigabytes(tmp_path, toolbox):
    stream = io.BytesIO()
    savemat(stream, toolbox)
    whole = stream.getvalue()
    body = zlib.compress(bytes(8_000_000))
    bomb = (15).to_bytes(4, "little") + len(body).to_bytes(4, "little") + body
    path = put(tmp_path, "a.mat", whole + bomb)
    assert same(sg.load_rig(path), make_rig())  # it is passed over
    small = zlib.compress(element({"x": np.zeros(8000)}))
    many = ((15).to_bytes(4, "little") + len(small).to_bytes(4, "little") + small) * 600
    refused("holds more than 32 MiB", put(tmp_path, "a.mat", whole + many))
    # SciPy's reader falls over when a type is none, and when a length is that of gigabytes.
    kind = whole.index(np.array([533.3333333333334]).tobytes()) - 8
    refused("fc_left holds values of type 200", put(tmp_path, "a.mat", whole[:kind] + b"\xc8" + whole[kind + 1 :]))
    place = whole.index(b"fc_left") + 8
    refused("damaged", put(tmp_path, "a.mat", whole[: place + 4] + b"\xf0\xff\xff\x7f" + whole[place + 8 :]))


def test_a_file_cut_off_anywhere_is_refused(tmp_path):
    sg.save_rig(make_rig(), tmp_path / "ros", format="ros")
    for name, _ in FILES[1:4]:
        path = sg.save_rig(make_rig(), tmp_path / name)[0]
        needed = {"rig.yml": b"unit", "rig.xml": b"</opencv", "rig.mat": b""}[name]
        data = path.read_bytes()
        end = data.index(needed) if needed else len(data)
        for length in range(0, end - 5, max(1, end // 40)):
            refused(name, put(tmp_path, name, data[:length]))
    left, right = (tmp_path / "ros" / f"{name}.yaml" for name in ("left", "right"))
    data = right.read_bytes()
    for length in range(0, data.index(b"stereo_gpu") - 5, 40):
        right.write_bytes(data[:length])
        refused("right", left, right)


def test_ros_files_that_do_not_belong(tmp_path):
    left, right = sg.save_rig(make_rig(), tmp_path / "ros", format="ros")
    refused("swapped", right, left)
    refused("file of one camera", left)
    refused("cameras stand at one point", left, left)
    text = left.read_text()
    refused("equidistant.*plumb_bob", put(tmp_path, "a.yaml", swap(text, "plumb_bob", "equidistant")), right)
    refused("has no camera_matrix", put(tmp_path, "a.yaml", swap(text, "camera_matrix", "camera_matrice")), right)
    refused("has no image_width", put(tmp_path, "a.yaml", swap(text, "image_width", "width")), right)
    refused(
        "rectification_matrix is no rotation", put(tmp_path, "a.yaml", swap(text, "data: [0.99", "data: [0.79")), right
    )
    refused("unit is 'furlong'", left, put(tmp_path, "b.yaml", swap(right.read_text(), "unit: mm", "unit: furlong")))
    far = right.read_text().replace("data: [-33.3", "data: [-1e308, 1e308]\n    x: [3")
    refused("no calibration has a number above", left, put(tmp_path, "b.yaml", far))
    near = swap(
        right.read_text(),
        "projection_matrix:\n  rows: 3\n  cols: 4\n  data: [",
        "projection_matrix:\n  data: [1e-320, 0, 1, 2, 0, 1e-320, 1, 1, 0, 0, 1e-320, 1e29]\n  x: [",
    )
    refused("gives a shift of", left, put(tmp_path, "b.yaml", near))
    old = put(tmp_path, "a.yaml", swap(text, "distortion_model: plumb_bob\n", ""))
    assert same(sg.load_rig(old, right), make_rig())


def test_arguments_that_are_wrong(tmp_path):
    path = sg.save_rig(make_rig(), tmp_path / "rig.yml")[0]
    own = sg.save_rig(make_rig(), tmp_path / "rig.json")[0]
    refused("unit 'furlong' is unknown", path, unit="furlong")
    refused("size is", path, size=(640, 0))
    refused("size is", path, size="640x480")
    for file in (path, own):
        refused("640 x 480 px, not of 320 x 240", file, size=(320, 240))
    refused("for KITTI's files", path, cameras=(0, 1))
    for cameras in (2, (2,), (2, 2), (0, 100), ("2", "3"), (0.0, 1.0)):
        refused("give the left and the right one's number", path, cameras=cameras)
    refused("0 calibration files")
    refused("3 calibration files", path, path, path)
    refused("is a folder without", tmp_path)
    refused("no such file", tmp_path / "none.yml")
    refused("give that one alone", put(tmp_path, "calib.txt", MIDDLEBURY), path)
    refused("give that one alone", path, own)
    with (tmp_path / "huge.yml").open("wb") as stream:
        stream.write(b"a: 1\n")
        stream.truncate(LARGEST_FILE + 1)
    refused("larger than 4 MiB", tmp_path / "huge.yml")
    assert sg.load_rig(own, unit="m").T[0] == pytest.approx(-0.1 / 3)


def test_what_a_format_cannot_hold_is_not_written(tmp_path):
    rig = make_rig(12)
    wide = replace(make_rig(), right=replace(make_rig().right, size=(648, 486)))
    odd = replace(make_rig(), unit="my mm")
    cases = [
        (rig, "a.mat", None, "toolbox's has 5"),
        (wide, "a.mat", None, "one size for both"),
        (rig, "ros", "ros", "ROS has names for 5 and 8"),
        (odd, "a.yml", None, "other signs than letters"),
        (replace(odd, unit="ell"), "ros", "ros", "ROS counts metres"),
        (rig, "a.txt", None, "ends in none of"),
        (rig, "a.yml", "opencv", "format 'opencv' is unknown"),
        (rig, "none/a.yml", None, "there is no folder"),
        (rig, "a.yaml", "ros", "name a folder"),
    ]
    for one, name, kind, told in cases:
        with pytest.raises(InputError, match=told):
            sg.save_rig(one, tmp_path / name, format=kind)
    assert list(tmp_path.iterdir()) == []


# The command.


def test_convert(tmp_path, capsys):
    path = sg.save_rig(make_rig(), tmp_path / "rig.json")[0]
    assert main(["convert", str(path), "--out", str(tmp_path / "ros"), "--format", "ros"]) == 0
    assert main(["convert", str(tmp_path / "ros"), "--out", str(tmp_path / "back.yml")]) == 0
    assert same(sg.load_rig(tmp_path / "back.yml"), make_rig())
    told = capsys.readouterr().out
    assert "back.yml: pictures of 640 x 480 px, 5 lens coefficients, baseline 33.3347 mm" in told
    kitti = put(tmp_path, "calib.txt", KITTI_ODOMETRY)
    more = ["--size", "1241x376", "--cameras", "0,1", "--unit", "cm"]
    assert main(["convert", str(kitti), "--out", str(tmp_path / "kitti.json"), *more]) == 0
    assert sg.Rig.load(tmp_path / "kitti.json").baseline == pytest.approx(53.7166, abs=1e-4)
    capsys.readouterr()
    for wrong in (["--size", "big"], ["--cameras", "left"], ["--format", "none"], []):
        out = tmp_path / ("a.json" if wrong else "a.txt")
        assert main(["convert", str(kitti), "--out", str(out), *wrong]) == 2
        assert capsys.readouterr().err.count("\n") == 1


def test_a_picture_tells_the_size_that_a_file_does_not(tmp_path, caplog):
    rig = make_rig()
    content = {"K1": rig.left.matrix, "D1": rig.left.distortion, "K2": rig.right.matrix, "D2": rig.right.distortion}
    path = opencv_file(tmp_path / "rig.yml", content | {"R": rig.R, "T": rig.T})
    assert load_rig_for(path, np.zeros((480, 640), np.uint8)).left.size == (640, 480)
    assert "taken as 640 x 480 px" in caplog.text
    kitti = put(tmp_path, "calib_cam_to_cam.txt", KITTI_RAW)
    assert load_rig_for(kitti, np.zeros((375, 1242), np.uint8)).left.matrix[0, 0] == 721.5377
    assert load_rig_for(kitti, np.zeros((512, 1392), np.uint8)).left.matrix[0, 0] == 984.2439
