"""The range found by itself: it holds the truth of every real pair, is not much wider, and wrong ones are told."""

import logging
import math

import cv2
import numpy as np
import pytest

import stereo_gpu as sg
from stereo_gpu.advice import range_warnings
from stereo_gpu.backends import open_backend
from stereo_gpu.disparity_range import find_range
from stereo_gpu.images import read_image
from stereo_gpu.match_options import LARGEST_RANGE
from stereo_gpu.range_ends import find_ends
from stereo_gpu.range_matches import find_surfaces

REAL = (
    ("teddy", "im2.png", "im6.png", 4),
    ("tsukuba", "im3.png", "im4.png", 16),
    ("motorcycle", "motorcycle_left.png", "motorcycle_right.png", None),
    ("aloe_light", "left.png", "right.png", 256),
    ("aloe_light", "left.png", "right_exposure.png", 256),
    ("aloe_light", "left.png", "right_light.png", 256),
)
WIDER = 1.5  # times the true range, the most that is found on average


def found(left, right, **known):
    """First and last disparity that are searched."""
    everywhere = np.ones(left.shape[:2], np.uint8)
    smallest, count = find_range(open_backend(), left, right, everywhere, everywhere, **known)
    return smallest, smallest + count - 1


def texture(width, height, seed=0):
    noise = np.random.default_rng(seed).integers(0, 256, (height, width)).astype(np.float32)
    blurred = cv2.GaussianBlur(noise, (0, 0), 1.2)
    return ((blurred - blurred.min()) / np.ptp(blurred) * 255).astype(np.uint8)


def plane(width, height, disparity, seed=0):
    """A textured plane that faces the cameras: left(x) is right(x - disparity)."""
    beside = abs(disparity)
    both = texture(width + 2 * beside, height, seed)
    right, left = both[:, beside : beside + width], both[:, beside - disparity : beside - disparity + width]
    return left.copy(), right.copy()


def put(pair, patch, x, y, disparity):
    """Paste a patch over both pictures, with its left edge at x of the right one."""
    rows = slice(y, y + patch.shape[0])
    pair[1][rows, x : x + patch.shape[1]] = patch
    pair[0][rows, x + disparity : x + disparity + patch.shape[1]] = patch


def real_pair(data, name, left, right, scale):
    folder = data / "stereo" / name
    if scale is None:
        truth = np.load(folder / "motorcycle_disp.npz")["arr_0"]
        truth = truth[np.isfinite(truth)]
    else:
        raw = cv2.imread(str(folder / "groundtruth.png"), cv2.IMREAD_UNCHANGED)
        truth = (raw if raw.ndim == 2 else raw[..., 0]) / scale
        truth = truth[truth > 0]
    return read_image(folder / left), read_image(folder / right), math.floor(truth.min()), math.ceil(truth.max())


def test_holds_the_truth_of_every_real_pair_and_is_not_much_wider(data):
    wider = []
    for case in REAL:
        left, right, least, most = real_pair(data, *case)
        first, last = found(left, right)
        assert first <= least and last >= most, f"{case}: {first} to {last}, truly {least} to {most}"
        wider.append((last - first + 1) / (most - least))
    assert np.mean(wider) <= WIDER
    assert max(wider) < 2.3


@pytest.mark.parametrize("moved", [-100, 100])
def test_moved_real_pair(data, moved):
    """With the right picture moved by 100 px, a real scene lies wholly behind infinity, or much nearer."""
    left, right, least, most = real_pair(data, *REAL[0])
    width = left.shape[1] - abs(moved)
    pair = (left[:, :width], right[:, -width:]) if moved > 0 else (left[:, -width:], right[:, :width])
    first, last = found(*(picture.copy() for picture in pair))
    assert first <= least + moved and last >= most + moved
    assert last - first <= WIDER * (most - least)


def test_enlarged_real_pair(data):
    """At four times the size the range is four times as long, found from shrunk pictures."""
    left, right, least, most = real_pair(data, *REAL[0])
    left, right = (cv2.resize(p, None, fx=4, fy=4, interpolation=cv2.INTER_CUBIC) for p in (left, right))
    first, last = found(left, right)
    assert first <= 4 * least and last >= 4 * most
    assert last - first <= WIDER * 4 * (most - least)


def test_boards(data, board_calibration):
    """The true disparities of a board's corners lie in the range of every one of the 13 pairs."""
    folder = data / "calibration" / "board_10x7"
    lefts, rights = (sorted(folder.glob(f"{side}*.jpg")) for side in ("left", "right"))
    rig = board_calibration.rig
    measured = 0
    for names in zip(lefts, rights, strict=True):
        pair = sg.rectify(*(read_image(name) for name in names), rig)
        corners = []
        for picture in (pair.left, pair.right):
            seen, places = cv2.findChessboardCornersSB(picture, (9, 6))
            corners.append(places.reshape(-1, 2) if seen else None)
        first, count = find_range(
            open_backend(), pair.left, pair.right, pair.valid_left, pair.valid_right, infinity_px=0.0
        )
        assert first >= 0
        assert count < 400
        if all(places is not None for places in corners):
            measured += 1
            disparity = corners[0][:, 0] - corners[1][:, 0]
            assert first <= disparity.min() and first + count - 1 >= disparity.max()
    assert measured >= 10


@pytest.mark.parametrize(("width", "height"), [(640, 480), (321, 243), (64, 48), (300, 20), (20, 300)])
def test_a_plane_that_faces_the_cameras(width, height):
    for disparity in (0, 3, width // 4, -width // 4, int(0.8 * width), -int(0.8 * width)):
        if width - abs(disparity) < 16:
            continue
        first, last = found(*plane(width, height, disparity))
        assert first <= disparity <= last
        assert last - first <= 6


def test_a_plane_in_large_pictures():
    first, last = found(*plane(3000, 1000, 900))
    assert first <= 900 <= last
    assert last - first <= 40


@pytest.mark.parametrize(("size", "disparity"), [(30, 60), (40, 200), (60, 400)])
def test_a_small_object_far_before_the_rest(size, disparity):
    pair = plane(640, 480, 20)
    put(pair, texture(size, size, 1), 100, 200, disparity)
    first, last = found(*pair)
    assert first <= 20 and last >= disparity
    assert last - first <= WIDER * (disparity - 20)


@pytest.mark.parametrize("size", [30, 60])
def test_a_small_hole_far_behind_the_rest(size):
    pair = plane(640, 480, 100)
    put(pair, texture(size, size, 1), 300, 200, 20)
    first, last = found(*pair)
    assert first <= 20 and last >= 100
    assert last - first <= WIDER * 80


def test_a_table_that_comes_nearer_with_every_row():
    width, height = 400, 300
    base = texture(width + 400, height).astype(np.float32)
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    disparity = 10 + 0.9 * np.maximum(y - 200, 0)  # a wall, then a table up to 99 px
    left = cv2.remap(base, x + 200 - disparity, y, cv2.INTER_CUBIC).astype(np.uint8)
    first, last = found(left, base[:, 200 : 200 + width].astype(np.uint8).copy())
    assert first <= 10 and last >= 99
    assert last - first <= WIDER * 89


@pytest.mark.parametrize("grain", [2.0, 8.0])
def test_a_repeated_texture(grain):
    """Stripes 16 px apart match anywhere; what else there is tells the true place."""
    rng = np.random.default_rng(1)
    stripes = 120 + 60 * np.sin(np.arange(800) * 2 * np.pi / 16) + np.zeros((480, 1))
    stripes += 40 * np.sin(np.arange(480) / 5)[:, None] + rng.normal(0, grain, stripes.shape)
    left, right = (
        np.clip(p + rng.normal(0, 1, p.shape), 0, 255).astype(np.uint8)
        for p in (stripes[:, 76:716], stripes[:, 100:740])
    )
    first, last = found(left, right)
    assert first <= 24 <= last
    assert last - first <= 6


@pytest.mark.parametrize("kind", ["flat", "noise"])
def test_searches_nearly_everything_where_nothing_matches(caplog, kind):
    rng = np.random.default_rng(2)
    pair = [np.full((240, 320), 120, np.uint8), np.full((240, 320), 120, np.uint8)]
    if kind == "noise":
        pair = [rng.integers(0, 256, (240, 320), np.uint8) for _ in range(2)]
    with caplog.at_level(logging.WARNING):
        assert found(*pair) == (-80, 239)
        assert found(*pair, infinity_px=-3.5) == (-4, 239)
    assert "too little of the pictures matches" in caplog.text


def test_marks_on_a_blank_wall():
    """Surfaces of a few pixels are none; features tell the range."""
    rng = np.random.default_rng(3)
    pair = [np.full((240, 320), 200, np.uint8) for _ in range(2)]
    for x in range(100, 148, 12):
        for y in range(90, 138, 12):
            put(pair, rng.integers(0, 200, (3, 3), np.uint8), x, y, 30)
    masks = [np.ones((240, 320), np.uint8)] * 2
    assert find_ends(find_surfaces(open_backend(), pair, masks, 0, 200)) is None
    first, last = found(*pair)
    assert first <= 30 <= last
    assert last - first <= 10


def test_bounds():
    """Nothing is searched behind infinity, and never more than can be."""
    assert found(*plane(320, 240, 5), infinity_px=4.5)[0] >= 4
    rng = np.random.default_rng(4)
    first, last = found(*(rng.integers(0, 256, (3, 20_000), np.uint8) for _ in range(2)))
    assert last - first + 1 <= LARGEST_RANGE


@pytest.mark.parametrize("shape", [(3, 3), (4, 300), (300, 4)])
def test_tiny_pictures(shape):
    rng = np.random.default_rng(1)
    first, last = found(*(rng.integers(0, 256, shape, np.uint8) for _ in range(2)))
    assert last >= first


def test_light_and_depth_of_pictures_change_little(data):
    left, right, least, most = real_pair(data, *REAL[0])
    dark = ((left / 255.0) ** 2 * 255).astype(np.uint8)
    for pair in ((dark, right), (left.astype(np.uint16) * 100, right.astype(np.uint16) * 100)):
        first, last = found(*pair)
        assert first <= least and last >= most
        assert last - first <= WIDER * (most - least)


def test_is_what_match_searches_by_default():
    left, right = plane(320, 240, 150)
    made = sg.match(left, right)
    assert made.smallest <= 150 < made.smallest + made.disparities
    assert np.nanmedian(made.values) == pytest.approx(150, abs=0.05)
    assert range_warnings(made) == []


@pytest.mark.parametrize(("given", "said"), [((12, 25), "largest"), ((25, 35), "smallest")])
def test_a_given_range_that_cuts_the_scene_off_is_told(data, caplog, given, said):
    left, right, _, _ = real_pair(data, *REAL[0])
    with caplog.at_level(logging.WARNING):
        sg.match(left, right, disparities=given)
    assert f"at the {said} one searched" in caplog.text
    caplog.clear()
    sg.match(left, right, disparities=(5, 60))
    assert caplog.text == ""


def test_nothing_lies_behind_infinity():
    made = sg.match(*plane(320, 240, 0), disparities=(0, 32))
    assert len(range_warnings(made)) == 1
    assert range_warnings(made, infinity_px=0.0) == []
