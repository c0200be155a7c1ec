"""Whether a rig still fits a raw pair: the real cup pair and board pairs, spoilt in known ways."""

import dataclasses
import json

import cv2
import numpy as np
import pytest

import stereo_gpu as sg
from stereo_gpu.check_figure import draw_check
from stereo_gpu.epipolar.drift import Drift, drifted
from stereo_gpu.epipolar.faults import Fault
from stereo_gpu.errors import InputError
from stereo_gpu.rig_check import REFUSE_PX, WARN_PX, Verdict, ideal_rig, refuse_bad

GOOD_PX = 0.25  # median vertical error of the cup pair with its own rig
SHIFT_PX, ANGLE_DEG, SCALE_PERCENT = 3.0, 0.5, 1.0
SHIFT_OFF_PX, ANGLE_OFF_DEG, SCALE_OFF_PERCENT = 0.3, 0.06, 0.3


@pytest.fixture(scope="module")
def cup_rig(data):
    """The calibration that the pictures' owner published."""
    file = cv2.FileStorage(str(data / "rigs" / "cup" / "published_opencv.yml"), cv2.FILE_STORAGE_READ)
    values = {name: file.getNode(name).mat() for name in ("K1", "D1", "K2", "D2", "R", "T")}
    cameras = [sg.Camera(values[f"K{i}"], values[f"D{i}"].ravel(), (640, 480)) for i in (1, 2)]
    return sg.Rig(*cameras, values["R"], values["T"].ravel())


@pytest.fixture(scope="module")
def cup(data):
    """The raw pair."""
    return tuple(sg.read_image(data / "rigs" / "cup" / "test_images" / f"{side}Pic.jpg") for side in ("left", "right"))


@pytest.fixture(scope="module")
def board_rig(data):
    """The rig of board_10x7, calibrated from six of its pairs."""
    folder = data / "calibration" / "board_10x7"
    left, right = (sorted(folder.glob(f"{side}*"))[::2] for side in ("left", "right"))
    return sg.calibrate(left, right, sg.Board(10, 7, 30.0), coefficients=5)


@pytest.fixture(scope="module")
def board_pair(data):
    """A pair of board_10x7 with much around the board."""
    return tuple(sg.read_image(data / "calibration" / "board_10x7" / f"{side}09.jpg") for side in ("left", "right"))


def lowered(picture, by):
    """The picture shifted down, its first row repeated."""
    place = np.array([[1, 0, 0], [0, 1, by]], np.float64)
    return cv2.warpAffine(picture, place, picture.shape[1::-1], borderMode=cv2.BORDER_REPLICATE)


def turned(picture, clockwise=0.0, larger=1.0):
    """The picture rotated about its middle, degrees, and scaled."""
    height, width = picture.shape[:2]
    place = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), -clockwise, larger)
    return cv2.warpAffine(picture, place, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


def perturbed(rig, turn, move=(0.0, 0.0)):
    """The rig as if its right camera had turned and moved, degrees."""
    return drifted(rig, Drift(turn=np.array(turn), move=np.array(move), deviations=np.zeros(5)))


def test_a_good_rig_is_called_good(cup, cup_rig):
    checked = sg.check_rig(*cup, cup_rig)
    assert checked.verdict is Verdict.GOOD and checked.fault is Fault.NONE
    assert checked.vertical_px <= GOOD_PX
    assert checked.vertical_95_px < 1.0 and abs(checked.bias_px) < GOOD_PX
    assert checked.behind < 0.05 and not checked.swapped
    assert "the rig is good" in checked.says
    refuse_bad(checked)


def test_another_good_rig_is_called_good(board_pair, board_rig):
    checked = sg.check_rig(*board_pair, board_rig)
    assert checked.verdict is Verdict.GOOD and checked.fault is Fault.NONE
    assert checked.vertical_px <= GOOD_PX


def test_swapped_pictures_are_named(cup, cup_rig, board_pair, board_rig):
    for pair, rig in ((cup, cup_rig), (board_pair, board_rig)):
        checked = sg.check_rig(*pair[::-1], rig)
        assert checked.fault is Fault.SWAPPED and checked.swapped
        assert checked.verdict is Verdict.BAD
        assert "look swapped" in checked.says and "left camera's picture first" in checked.says
        with pytest.raises(InputError, match="look swapped"):
            refuse_bad(checked)


def test_the_rig_of_other_cameras_is_named(cup, cup_rig, board_pair, board_rig):
    for pair, rig in ((cup, board_rig), (board_pair, cup_rig)):
        checked = sg.check_rig(*pair, rig)
        assert checked.fault is Fault.OTHER_RIG and checked.verdict is Verdict.BAD
        assert checked.vertical_px > REFUSE_PX
        assert "belongs to other cameras" in checked.says and "own rig" in checked.says


def test_a_rig_that_is_unlike_any_of_these_cameras_is_named(cup, cup_rig):
    """Turned by 40 degrees about the axis, no rows agree; the features themselves do, so that it is not for them."""
    checked = sg.check_rig(*cup, perturbed(cup_rig, (0.0, 0.0, 40.0)))
    assert checked.fault is Fault.OTHER_RIG and checked.verdict is Verdict.BAD
    assert "belongs to other cameras" in checked.says
    with pytest.raises(InputError, match="belongs to other cameras"):
        refuse_bad(checked)


@pytest.mark.parametrize(("side", "by"), [(1, SHIFT_PX), (0, SHIFT_PX), (1, -SHIFT_PX)])
def test_a_shifted_picture_is_named(cup, cup_rig, board_pair, board_rig, side, by):
    for pair, rig in ((cup, cup_rig), (board_pair, board_rig)):
        spoilt = list(pair)
        spoilt[side] = lowered(pair[side], by)
        checked = sg.check_rig(*spoilt, rig)
        assert checked.fault is Fault.SHIFTED and checked.verdict is Verdict.BAD
        right_down = by if side else -by
        assert checked.amount == pytest.approx(right_down, abs=SHIFT_OFF_PX)
        # Shifting the left picture up is the same as shifting the right one down.
        lower = "right" if right_down > 0 else "left"
        assert f"the {lower} picture is shifted down by {abs(checked.amount):.1f} px" in checked.says
        degrees = np.degrees(abs(checked.amount) / rig.left.matrix[1, 1])
        assert f"pitched by {degrees:.2f} degrees" in checked.says


@pytest.mark.parametrize(("side", "by"), [(1, ANGLE_DEG), (0, ANGLE_DEG), (1, -ANGLE_DEG)])
def test_a_rotated_picture_is_named(cup, cup_rig, board_pair, board_rig, side, by):
    for pair, rig in ((cup, cup_rig), (board_pair, board_rig)):
        spoilt = list(pair)
        spoilt[side] = turned(pair[side], by)
        checked = sg.check_rig(*spoilt, rig)
        assert checked.fault is Fault.ROTATED
        assert checked.verdict is not Verdict.GOOD and checked.vertical_px > WARN_PX
        assert checked.amount == pytest.approx(by if side else -by, abs=ANGLE_OFF_DEG)
        assert f"rotated by {abs(checked.amount):.2f} degrees" in checked.says
        direction = "clockwise" if by > 0 else "anticlockwise"
        assert f"the {('left', 'right')[side]} picture is rotated" in checked.says and f" {direction} " in checked.says


@pytest.mark.parametrize("side", [0, 1])
def test_a_zoomed_picture_is_named(cup, cup_rig, side):
    spoilt = list(cup)
    spoilt[side] = turned(cup[side], larger=1 + SCALE_PERCENT / 100)
    checked = sg.check_rig(*spoilt, cup_rig)
    assert checked.fault is Fault.SCALED
    assert checked.amount == pytest.approx(SCALE_PERCENT if side else -SCALE_PERCENT, abs=SCALE_OFF_PERCENT)
    assert "zoom or focus" in checked.says


def test_a_moved_camera_is_named(board_pair, board_rig):
    checked = sg.check_rig(*board_pair, perturbed(board_rig, (0.25, 0.4, -0.5)))
    assert checked.fault is Fault.MOVED
    assert "a camera moved since the calibration" in checked.says and "--refine" in checked.says


@pytest.fixture(scope="module")
def cup_boards(data):
    """Reads a pair of the cup rig's board pictures: few features, all near the middle."""
    folder = data / "rigs" / "cup" / "calibration_images"
    return lambda number: tuple(sg.read_image(folder / f"{side}Pic{number}.jpg") for side in ("left", "right"))


def test_rows_that_fit_are_not_refused_for_a_turn_that_they_hardly_tell(cup_boards, cup_rig):
    checked = sg.check_rig(*cup_boards("30"), cup_rig)
    assert checked.vertical_px < WARN_PX
    assert (checked.verdict, checked.fault) == (Verdict.GOOD, Fault.NONE)


@pytest.mark.parametrize("number", ["01", "06"])
def test_few_features_of_a_board_that_repeats_do_not_refuse_a_good_rig(cup_boards, cup_rig, number):
    checked = sg.check_rig(*cup_boards(number), cup_rig)
    assert checked.verdict is Verdict.UNKNOWN
    assert "a pattern that repeats" in checked.says
    refuse_bad(checked)


def test_rows_below_the_limit_are_not_refused_whatever_the_cause(cup, cup_rig):
    drift = Drift(turn=np.array([0.1, 5.0, -1.0]), move=np.zeros(2), deviations=np.zeros(5))
    checked = sg.check_rig(*cup, drifted(cup_rig, drift))
    assert WARN_PX < checked.vertical_px < REFUSE_PX
    assert (checked.verdict, checked.fault) == (Verdict.DOUBTFUL, Fault.OTHER_RIG)


def test_swapped_is_said_where_the_rig_is_doubtful_too(cup_boards, cup_rig):
    assert sg.check_rig(*cup_boards("05")[::-1], cup_rig).fault is Fault.SWAPPED


def test_mirrored_pictures_are_said(cup, cup_rig):
    checked = sg.check_rig(*(np.ascontiguousarray(picture[:, ::-1]) for picture in cup), cup_rig)
    assert checked.verdict is Verdict.BAD and "mirrored" in checked.says


def test_one_picture_given_twice_is_refused(cup, cup_rig):
    with pytest.raises(InputError, match="one and the same: give one of each camera"):
        sg.check_rig(cup[0], cup[0].copy(), cup_rig)


def test_what_moves_by_itself_does_not_decide(cup, cup_rig):
    """The cup itself, which has most of the features, shows a drift; a part of it torn down by 12 px does not."""
    left, right = cup
    torn = right.copy()
    torn[240:320, 310:370] = right[228:308, 310:370]
    checked = sg.check_rig(left, torn, cup_rig)
    assert len(checked.vertical) < 0.9 * len(sg.check_rig(left, right, cup_rig).vertical)
    assert checked.verdict is Verdict.GOOD and checked.fault is Fault.NONE
    assert checked.vertical_px <= GOOD_PX


def test_nothing_is_concluded_from_few_or_contrary_features(cup, cup_rig, board_pair):
    flat = np.full((480, 640), 90, np.uint8)
    noise = np.random.default_rng(1).integers(0, 256, (480, 640), np.uint8)
    for left, right in ((flat, flat), (cup[0], flat), (cup[0], board_pair[1]), (cup[0], noise)):
        checked = sg.check_rig(left, right, cup_rig)
        assert checked.verdict is Verdict.UNKNOWN and checked.fault is Fault.NONE
        assert "nothing can be said of the rig" in checked.says and "texture" in checked.says
        assert np.isnan(checked.vertical_px) and len(checked.vertical) == 0
        refuse_bad(checked)
        assert json.loads(json.dumps(checked.record(), allow_nan=False))["vertical_px"] is None
        assert draw_check(left, checked).shape[1] > 640


def test_wrong_pictures_are_refused(cup, cup_rig):
    left, right = cup
    for pair, says in (
        ((left[:-1], right), "640 x 479"),
        ((left[:100], right[:100]), "calibrated for 640 x 480"),
        ((left, right.astype(np.uint16)), "uint16"),
        ((left.astype(float) * np.nan, right), "not finite"),
        ((left[:1, :1], right[:1, :1]), "1 x 1"),
    ):
        with pytest.raises(InputError, match=says):
            sg.check_rig(*pair, cup_rig)


def test_large_deep_and_coloured_pictures(cup, cup_rig):
    """Pictures eight times as large keep the accuracy that the small ones have, which is in their own pixels."""
    deep = [np.repeat(p[..., None], 3, axis=2).astype(np.uint16) * 16 for p in cup]
    assert sg.check_rig(*deep, cup_rig).vertical_px <= GOOD_PX
    scale = 4
    large = [cv2.resize(p, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC) for p in cup]
    cameras = []
    for camera in (cup_rig.left, cup_rig.right):
        matrix = camera.matrix.copy()
        matrix[:2] *= scale
        matrix[:2, 2] += (scale - 1) / 2  # pixel centres are at whole numbers
        cameras.append(sg.Camera(matrix, camera.distortion, (640 * scale, 480 * scale)))
    checked = sg.check_rig(*large, dataclasses.replace(cup_rig, left=cameras[0], right=cameras[1]))
    assert checked.verdict is Verdict.GOOD
    assert checked.vertical_px <= scale * 0.11


def test_numbers_and_picture_of_the_map(cup, cup_rig):
    left, right = cup
    checked = sg.check_rig(left, lowered(right, SHIFT_PX), cup_rig)
    known = np.isfinite(checked.map.values)
    assert known.sum() >= 8 and checked.map.counts.sum() == len(checked.vertical)
    # The right picture's rows are larger where it was shifted down.
    assert np.abs(checked.map.values[known] + SHIFT_PX).max() < 1.0
    record = json.loads(json.dumps(checked.record(), allow_nan=False))
    assert record["fault"] == "shifted" and record["used"] == len(checked.vertical)
    assert np.array(record["map_px"], float).shape == checked.map.values.shape
    drawn = draw_check(left, checked)
    assert drawn.dtype == np.uint8 and drawn.shape[0] > 720 and drawn.shape[1] > 960
    # Blue, as the right picture lies lower: there, and not in the picture of a good rig.
    good = draw_check(left, sg.check_rig(left, right, cup_rig))
    blue = [(p[:720, :960, 2].astype(int) - p[:720, :960, 0] > 60).mean() for p in (drawn, good)]
    assert blue[0] > 0.2 and blue[1] < 0.02


@pytest.mark.parametrize("size", [(20000, 40), (40, 20000), (3, 3), (2, 600)])
def test_pictures_of_odd_shapes_are_drawn_small(size):
    camera = sg.Camera(np.array([[900.0, 0, size[0] / 2], [0, 900, size[1] / 2], [0, 0, 1]]), np.zeros(5), size)
    picture = np.random.default_rng(6).integers(0, 256, size[::-1], np.uint8)
    if min(size) < 3:
        with pytest.raises(InputError, match="3 px a side"):
            sg.check_rig(picture, picture, sg.Rig(camera, camera, np.eye(3), np.array([-50.0, 0, 0])))
        return
    checked = sg.check_rig(picture, picture[:, ::-1].copy(), sg.Rig(camera, camera, np.eye(3), np.array([-50.0, 0, 0])))
    assert checked.verdict is Verdict.UNKNOWN
    assert draw_check(picture, checked).size < 40_000_000


def test_a_rectified_pair_has_an_ideal_rig(small_scene, raw_folder):
    pictures = [sg.read_image(raw_folder / f"{side}.png") for side in ("left", "right")]
    assert sg.check_rig(*pictures, small_scene.rig).verdict is Verdict.GOOD
    pair = sg.rectify(*pictures, small_scene.rig)
    checked = sg.check_rig(pair.left, pair.right, ideal_rig(pair))
    assert checked.verdict is Verdict.GOOD and checked.vertical_px < GOOD_PX
    spoilt = sg.check_rig(pair.left, lowered(pair.right, SHIFT_PX), ideal_rig(pair))
    assert spoilt.fault is Fault.SHIFTED
    assert spoilt.amount == pytest.approx(SHIFT_PX, abs=SHIFT_OFF_PX)
