import json
import re

import boards
import cv2
import numpy as np
import pytest

from stereo_gpu.boards.board import Board
from stereo_gpu.calibrate import calibrate, calibrate_in_full
from stereo_gpu.calibration.summary import epipolar_errors
from stereo_gpu.calibration.table import calibration_table
from stereo_gpu.errors import CalibrationError, InputError, PictureError
from stereo_gpu.images import write_png
from stereo_gpu.rig import Camera, Rig

BOARD = Board(columns=9, rows=7, square=30.0)  # both odd: turned by 180 degrees it looks the same
ROTATION = cv2.Rodrigues(np.array([0.02, -0.06, 0.01]))[0]
SHIFT = np.array([-60.0, 1.5, 2.0])


def pairs(rotation, shift, count=9, turned=0.0):
    left, right = [], []
    for number, pose in enumerate(boards.poses(BOARD, count, seed=8, turned=turned)):
        left.append(boards.render(BOARD, boards.LEFT, *pose, seed=2 * number))
        right.append(boards.render(BOARD, boards.RIGHT, *boards.moved(*pose, rotation, shift), seed=2 * number + 1))
    return left, right


@pytest.fixture(scope="module", autouse=True)
def searched_once():
    """Spare the tests that share pictures the search of all but the first."""
    found = {}
    search = Board.find

    def remembered(board, picture):
        key = board, picture.shape, picture.tobytes()
        if key not in found:
            found[key] = search(board, picture)
        return found[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Board, "find", remembered)
        yield


@pytest.fixture(scope="module")
def taken():
    return pairs(ROTATION, SHIFT)


def degrees(one, other):
    return np.rad2deg(np.linalg.norm(cv2.Rodrigues(one @ other.T)[0]))


def test_the_truth_comes_back(taken):
    told = []
    rig = calibrate(*taken, BOARD, progress=lambda done, total: told.append((done, total)))
    assert all(view.used for view in rig.views)
    assert [view.left for view in rig.views] == [f"left {number}" for number in range(1, 10)]
    assert rig.rms_px < 0.06
    assert rig.epipolar_rms_px < 0.06
    assert all(view.left_px < 0.1 and view.right_px < 0.1 and view.epipolar_px < 0.1 for view in rig.views)
    np.testing.assert_allclose(rig.T, SHIFT, atol=0.6)
    assert rig.baseline == pytest.approx(np.linalg.norm(SHIFT), rel=2e-3)
    assert degrees(rig.R, ROTATION) < 0.15
    for camera, (matrix, _) in ((rig.left, boards.LEFT), (rig.right, boards.RIGHT)):
        assert camera.size == boards.SIZE
        assert camera.rms_px < 0.06
        np.testing.assert_allclose(camera.matrix, matrix, atol=1.5)
    assert told == [(number, 18) for number in range(1, 19)]


@pytest.mark.parametrize("coefficients", [8, 12])
def test_more_lens_coefficients(taken, coefficients):
    rig = calibrate(*taken, BOARD, coefficients=coefficients)
    assert rig.left.distortion.shape == rig.right.distortion.shape == (coefficients,)
    assert rig.rms_px < 0.06
    assert rig.baseline == pytest.approx(np.linalg.norm(SHIFT), rel=0.02)


def test_boards_seen_turned_by_180_degrees():
    # The right camera hangs upside down, so that the finder starts at the other end of the board.
    upside_down = np.diag([-1.0, -1.0, 1.0]) @ ROTATION
    rig = calibrate(*pairs(upside_down, np.array([60.0, -1.5, 2.0]), count=6), BOARD)
    assert all(view.used for view in rig.views)
    assert degrees(rig.R, upside_down) < 0.2
    np.testing.assert_allclose(rig.T, [60.0, -1.5, 2.0], atol=1.0)


def test_views_that_do_not_fit_are_left_out_with_a_reason(taken):
    left, right = [list(views) for views in taken]
    right[1], right[2] = right[2], right[1]  # belong elsewhere
    left[4] = np.full_like(left[4], 90)  # no board
    rows, columns = np.mgrid[: left[6].shape[0], : left[6].shape[1]].astype(np.float32)
    left[6] = cv2.remap(left[6], columns + 2.5 * np.sin(rows / 25), rows, cv2.INTER_LINEAR)  # the board was bent
    rig = calibrate(left, right, BOARD)
    assert [number for number, view in enumerate(rig.views) if not view.used] == [1, 2, 4, 6]
    assert "do not belong together" in rig.views[1].reason
    assert "do not belong together" in rig.views[2].reason
    assert rig.views[4].reason == "no whole board in the left picture"
    assert re.fullmatch(r"does not fit the left camera: \d\.\d\d px, typical 0\.\d\d px", rig.views[6].reason)
    assert all(view.left_px is None for view in rig.views if not view.used)
    np.testing.assert_allclose(rig.T, SHIFT, atol=1.0)


def test_swapped_pictures_are_named(taken):
    with pytest.raises(CalibrationError, match="left and right look swapped"):
        calibrate(taken[1], taken[0], BOARD)


def test_the_same_pictures_twice_are_named(taken):
    with pytest.raises(CalibrationError, match="the cameras stand at one point"):
        calibrate(taken[0], taken[0], BOARD)


def test_pictures_given_again_count_once(taken):
    again = [[*side[:5], side[0]] for side in taken]
    rig = calibrate(*again, BOARD, coefficients=5)
    assert [view.used for view in rig.views] == [True] * 5 + [False]
    assert rig.views[5].reason == "the same pictures as an earlier pair: left 1, right 1"
    with pytest.raises(CalibrationError, match=r"1 of 3 pairs fit together, 3 are needed \(2 x the same pictures as"):
        calibrate(*([side[0]] * 3 for side in taken), BOARD)


def test_lists_in_another_order_are_named(taken):
    with pytest.raises(CalibrationError, match="the pairs do not agree on one rig"):
        calibrate(taken[0], [taken[1][number] for number in (4, 8, 1, 6, 3, 0, 7, 2, 5)], BOARD)


@pytest.fixture(scope="module")
def small(taken):
    """The same pictures at half the size, in which a board that is not there is missed sooner."""
    return [[cv2.resize(view, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA) for view in views] for views in taken]


@pytest.mark.parametrize("wrong", [Board(8, 6, 30), Board(12, 5, 30)], ids=str)
def test_a_wrong_count_is_named_with_the_right_one(small, wrong):
    with pytest.raises(CalibrationError, match="8x6 inner corners = 9x7 squares: say 9x7"):
        calibrate(small[0][:3], small[1][:3], wrong)


def test_a_wrong_count_is_named_early(small):
    told = []
    with pytest.raises(CalibrationError, match="say 9x7"):
        calibrate(*small, Board(8, 6, 30), progress=lambda done, total: told.append((done, total)))
    assert told[-1] == (4, 18)  # two pairs that agree are enough


def test_columns_and_rows_may_be_given_either_way(taken):
    rig = calibrate(*taken, Board(BOARD.rows, BOARD.columns, 30))
    assert rig.baseline == pytest.approx(np.linalg.norm(SHIFT), rel=2e-3)


def test_no_board_anywhere():
    empty = [np.full((90, 120), 128, np.uint8)] * 3
    with pytest.raises(CalibrationError, match=r"0 of 3 pairs show a whole board of 9x7 squares \(8x6 inner corners\)"):
        calibrate(empty, empty, BOARD)


def test_lists_that_cannot_be_pairs(taken):
    left, right = taken
    with pytest.raises(InputError, match="9 left pictures but 8 right ones"):
        calibrate(left, right[1:], BOARD)
    with pytest.raises(CalibrationError, match="2 pairs: a calibration needs 3 or more"):
        calibrate(left[:2], right[:2], BOARD)
    with pytest.raises(CalibrationError, match="1 pair: a calibration needs 3 or more"):
        calibrate(left[:1], right[:1], BOARD)
    with pytest.raises(InputError, match=r"board is '9x7': give one such as Board"):
        calibrate(left, right, "9x7")
    with pytest.raises(InputError, match="left is a single picture"):
        calibrate("left.png", ["right.png"], BOARD)
    with pytest.raises(InputError, match="right is a single picture"):
        calibrate(left, right[0], BOARD)
    with pytest.raises(InputError, match="coefficients is 6: give 5, 8, 12 or auto"):
        calibrate(left, right, BOARD, coefficients=6)


def test_pictures_that_cannot_be_used(taken, tmp_path):
    left, right = taken
    with pytest.raises(PictureError, match=r"8 of 9 are 480 x 360 px, but left 9 is 471 x 360"):
        calibrate([*left[:8], left[8][:, 9:]], right, BOARD)
    with pytest.raises(PictureError, match="right 1 is 1 x 1 px"):
        calibrate(left, [right[0][:1, :1], *right[1:]], BOARD)
    with pytest.raises(PictureError, match=r"none\.png: there is no such file"):
        calibrate(left, [tmp_path / "none.png", *right[1:]], BOARD)
    path = write_png(tmp_path / "cut.png", right[0])
    path.write_bytes(path.read_bytes()[:-1000])
    with pytest.raises(PictureError, match=r"cut\.png is cut off"):
        calibrate(left, [path, *right[1:]], BOARD)


def test_epipolar_errors_are_distances_from_lines():
    camera = Camera(np.diag([500.0, 500.0, 1.0]), np.zeros(5), (640, 480))
    left = np.array([[10, 20], [30, 40], [50, 60]], np.float32)
    off = np.array([[-7, 0.5], [-9, 0.5], [-1, -0.5]], np.float32)
    [error] = epipolar_errors([left], [left + off], camera, camera, np.eye(3), np.array([-100.0, 0, 0]))
    assert error == pytest.approx(0.5)  # level lines: only the vertical distance counts


def test_every_pair_is_accounted_for(taken):
    left, right = [list(views) for views in taken]
    left[4] = np.full_like(left[4], 90)  # no board
    right[1], right[2] = right[2], right[1]  # belong elsewhere
    calibration = calibrate_in_full(left, right, BOARD)
    assert [view.used for view in calibration.views] == [view.used for view in calibration.rig.views]
    assert [view.reason for view in calibration.views] == [view.reason for view in calibration.rig.views]
    for number, (view, errors) in enumerate(zip(calibration.views, calibration.rig.views, strict=True)):
        for side, told in enumerate((errors.left_px, errors.right_px)):
            if number == 4 and side == 0:
                assert view.seen[0] is None and view.projected[0] is None and view.rotation is None
                continue
            assert view.seen[side].shape == view.projected[side].shape == (48, 2)
            off = np.sqrt(((view.seen[side] - view.projected[side]) ** 2).sum(axis=1).mean())
            assert off < 0.2  # of pairs left out each picture has its own pose
            if view.used:
                assert off == pytest.approx(told, abs=1e-4)
    pose = calibration.views[0].rotation, calibration.views[0].translation
    camera = calibration.rig.left
    again = cv2.projectPoints(BOARD.points, cv2.Rodrigues(pose[0])[0], pose[1], camera.matrix, camera.distortion)[0]
    np.testing.assert_allclose(again.reshape(-1, 2), calibration.views[0].projected[0], atol=1e-3)


def test_what_is_told_besides(taken):
    calibration = calibrate_in_full(*taken, BOARD)
    assert calibration.models.chosen == len(calibration.rig.left.distortion) == 5
    assert calibration.rig.deviations is calibration.deviations
    assert "9 pairs are few: take 10 or more" in calibration.advice
    assert calibration.advice[-1].startswith("next: hold the board ")
    distance, deviation = calibration.depth
    assert 300 < distance < 700 and 0 < deviation < 0.01 * distance
    errors = np.abs(calibration.rig.T - SHIFT), calibration.deviations.T
    assert (errors[0] < 4 * errors[1]).all()  # the truth lies where the deviations say
    text = "\n".join(calibration_table(calibration))
    assert "fx, px" in text and "+-" in text and "5 coefficients; error on views left out" in text


def test_published_rig_of_the_matlab_toolbox(data, board_calibration, tmp_path):
    published = json.loads((data / "calibration" / "board_10x7" / "published.json").read_text())
    assert board_calibration.board.square == published["square_mm"]
    rig, deviations = board_calibration.rig, board_calibration.deviations
    assert [view.used for view in rig.views] == [True] * 13
    assert rig.rms_px <= 0.30
    assert max(rig.left.rms_px, rig.right.rms_px) <= 0.25
    om = cv2.Rodrigues(rig.R)[0].reshape(3)
    # The toolbox calls about three standard deviations the uncertainty.
    for name, ours, theirs, three, told in (
        ("T, mm", rig.T, published["T_mm"], 3 * deviations.T, published["T_uncertainty_mm"]),
        ("om, rad", om, published["om_rad"], 3 * deviations.om, published["om_uncertainty_rad"]),
    ):
        for axis in range(3):
            print(
                f"{name} {'xyz'[axis]}: {ours[axis]:9.5f} +- {three[axis]:.5f},"
                f" published {theirs[axis]:9.5f} +- {told[axis]:.5f}"
            )
        np.testing.assert_array_less(np.abs(ours - theirs), 2 * np.array(told))
        np.testing.assert_allclose(three, told, rtol=0.2)
    assert board_calibration.models.chosen == 5
    np.testing.assert_array_equal(Rig.load(rig.save(tmp_path / "rig.json")).T, rig.T)


def test_published_rig_of_the_cup(data):
    folder = data / "rigs" / "cup"
    published = cv2.FileStorage(str(folder / "published_opencv.yml"), cv2.FILE_STORAGE_READ)
    translation = published.getNode("T").mat().reshape(3)
    pictures = folder / "calibration_images"
    calibration = calibrate_in_full(
        sorted(pictures.glob("left*.jpg")), sorted(pictures.glob("right*.jpg")), Board(12, 9, 12.0)
    )
    rig = calibration.rig
    assert sum(view.used for view in rig.views) == 29
    assert rig.views[6].reason == "no whole board in the left picture"  # the picture's border cuts it
    assert rig.rms_px <= 0.20
    assert rig.baseline == pytest.approx(np.linalg.norm(translation), rel=1e-3)
    assert np.linalg.norm(rig.T - translation) <= 0.003 * np.linalg.norm(translation)
    assert degrees(rig.R, published.getNode("R").mat()) < 0.3
    # Twelve coefficients predict views left out better, but make the rig many times less certain.
    models = calibration.models
    assert models.chosen == 5
    assert models.errors_px[12] < models.errors_px[5]
    assert re.fullmatch(r"R or T would be \d+\.\d times less certain", models.refused[12])
