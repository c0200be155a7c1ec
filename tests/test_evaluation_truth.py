import struct

import cv2
import numpy as np
import pytest

from stereo_gpu.errors import InputError
from stereo_gpu.evaluation.truth import read_disparity, read_truth
from stereo_gpu.images import write_png
from stereo_gpu.pfm import write_pfm

VALUES = np.array([[1.5, -2.25, 300.0], [np.nan, 0.0, 4.0]], np.float32)


@pytest.mark.parametrize(("order", "scale"), [("<", b"-1.0"), (">", b"1.0"), ("<", b"-0.003922")])
def test_pfm_of_either_byte_order_bottom_row_first(tmp_path, order, scale):
    """The header's scale tells the byte order; its size is not for disparities, and OpenCV multiplies by it."""
    rows = struct.pack(f"{order}6f", np.inf, 0.0, 4.0, 1.5, -2.25, 300.0)
    (tmp_path / "map.pfm").write_bytes(b"Pf\n3 2\n" + scale + b"\n" + rows)
    np.testing.assert_array_equal(read_disparity(tmp_path / "map.pfm"), VALUES)


def test_pfm_as_we_write_it(tmp_path):
    np.testing.assert_array_equal(read_disparity(write_pfm(tmp_path / "map.PFM", VALUES)), VALUES)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_numpy_files(tmp_path, dtype):
    stored = np.where(np.isnan(VALUES), np.inf, VALUES).astype(dtype)
    np.save(tmp_path / "map.npy", stored)
    np.savez_compressed(tmp_path / "map.npz", stored)
    for name in ("map.npy", "map.npz"):
        found = read_disparity(tmp_path / name)
        assert found.dtype == np.float32
        np.testing.assert_array_equal(found, VALUES)


def test_numpy_files_of_fixed_point_numbers(tmp_path):
    """What cv2.StereoSGBM computes: int16, 16 a px."""
    np.save(tmp_path / "map.npy", np.array([[8, -16, 40]], np.int16))
    np.testing.assert_array_equal(read_disparity(tmp_path / "map.npy", 16), [[0.5, -1, 2.5]])


def test_doubles_too_large_for_a_float_are_no_value(tmp_path):
    np.save(tmp_path / "map.npy", np.array([[1e300, 2.0]]))
    np.testing.assert_array_equal(read_disparity(tmp_path / "map.npy"), [[np.nan, 2]])


def test_kitti(tmp_path):
    write_png(tmp_path / "map.png", np.array([[0, 256, 384], [1, 65535, 25600], [0, 0, 0]], np.uint16))
    expected = [[np.nan, 1, 1.5], [1 / 256, 65535 / 256, 100], [np.nan] * 3]
    np.testing.assert_array_equal(read_disparity(tmp_path / "map.png"), np.array(expected, np.float32))
    np.testing.assert_array_equal(read_disparity(tmp_path / "map.png", 128), 2 * np.array(expected, np.float32))


@pytest.mark.parametrize("ending", ["png", "pgm"])
@pytest.mark.parametrize("channels", [1, 3])
def test_middlebury(tmp_path, ending, channels):
    levels = np.array([[0, 4, 6], [255, 8, 1], [2, 2, 2]], np.uint8)
    stored = levels if channels == 1 else np.repeat(levels[..., None], 3, axis=2)
    name = tmp_path / f"map.{ending if channels == 1 else ending.replace('pgm', 'ppm')}"
    assert cv2.imwrite(str(name), stored)
    expected = np.where(levels == 0, np.nan, levels / 4).astype(np.float32)
    np.testing.assert_array_equal(read_disparity(name, 4), expected)


def test_published_truths(data):
    stereo = data / "stereo"
    teddy = read_truth(stereo / "teddy" / "groundtruth.png", 4)
    assert teddy.shape == (375, 450) and np.isnan(teddy).sum() == 3406
    tsukuba = read_truth(stereo / "tsukuba" / "groundtruth.png", 16)
    assert np.isfinite(tsukuba).sum() == 87696 and set(np.unique(tsukuba[np.isfinite(tsukuba)])) <= set(range(1, 16))
    aloe = read_truth(stereo / "aloe_light" / "groundtruth.png")
    assert 60 < np.nanmax(aloe) < 80
    motorcycle = read_truth(stereo / "motorcycle" / "motorcycle_disp.npz")
    assert motorcycle.shape == (500, 741) and 0.9 < np.isfinite(motorcycle).mean() < 0.95


def write_bytes(path, content):
    path.write_bytes(content)
    return path


@pytest.mark.parametrize(
    ("name", "make", "scale", "says"),
    [
        ("gone.pfm", None, None, "cannot read .*gone.pfm: No such file"),
        ("gone.npy", None, None, "cannot read .*gone.npy: No such file"),
        ("gone.png", None, None, "gone.png: there is no such file"),
        ("a.png", lambda path: write_png(path, np.ones((5, 4), np.uint8)), None, "a.png has 8 bits: say how many"),
        ("a.png", lambda path: write_png(path, np.ones((5, 4), np.uint8)), 0, "scale = 0 is no positive number"),
        ("a.png", lambda path: write_png(path, np.ones((5, 4), np.uint8)), np.nan, "scale = nan"),
        ("a.png", lambda path: write_png(path, np.eye(3, dtype=np.uint8)[None].repeat(3, 0)), 4, "is in colour"),
        ("a.npy", lambda path: np.save(path, np.zeros((3, 4, 2))), None, r"float64 of shape \(3, 4, 2\)"),
        ("a.npy", lambda path: np.save(path, np.zeros((3, 4), complex)), None, "complex128"),
        ("a.npy", lambda path: np.save(path, np.array([[{}]]), allow_pickle=True), None, "no file of numbers"),
        ("a.npy", lambda path: write_bytes(path, b""), None, "no file of numbers"),
        ("a.npz", lambda path: write_bytes(path, b"PK\x03\x04 and no more"), None, "no file of numbers"),
        ("a.npz", lambda path: np.savez(path, VALUES, VALUES), None, "holds 2 arrays"),
        ("a.pfm", lambda path: write_bytes(path, b"Pf\n3 2\n-1\n1234"), None, "is cut off"),
        ("a.pfm", lambda path: write_bytes(path, b"PF\n1 1\n-1\n" + bytes(12)), None, "not a PFM of one channel"),
    ],
)
def test_what_is_no_map_is_refused(tmp_path, name, make, scale, says):
    if make:
        make(tmp_path / name)
    with pytest.raises(InputError, match=says):
        read_disparity(tmp_path / name, scale)


def test_a_truth_must_know_something(tmp_path):
    write_png(tmp_path / "empty.png", np.zeros((5, 4), np.uint16))
    assert np.isnan(read_disparity(tmp_path / "empty.png")).all()
    with pytest.raises(InputError, match="truth of none of its 20 pixels"):
        read_truth(tmp_path / "empty.png")
