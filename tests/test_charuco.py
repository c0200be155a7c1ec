"""ChArUco boards: what is found of them, in part too, and how another board than the named one is told."""

import re

import boards
import cv2
import numpy as np
import pytest

import stereo_gpu as sg
from stereo_gpu.boards.board_pairs import find_pairs
from stereo_gpu.boards.board_print import rasterise
from stereo_gpu.boards.charuco import CharucoBoard
from stereo_gpu.boards.markers import marker_squares
from stereo_gpu.boards.neighbours import fits_neighbours
from stereo_gpu.boards.sheet import lay_out
from stereo_gpu.errors import CalibrationError, InputError

BOARD = CharucoBoard(8, 6, 30.0, 22.0)
DOTS = 60  # a square of the drawings
ROTATION = cv2.Rodrigues(np.array([0.02, -0.06, 0.01]))[0]
SHIFT = np.array([-60.0, 1.5, 2.0])


def drawing(board):
    """The board alone, as it is printed."""
    sheet = lay_out(board, "fit")
    page = rasterise(sheet, DOTS / board.square)
    left, top = (round(place * DOTS / board.square) for place in sheet.origin)
    return page[top : top + board.rows * DOTS, left : left + board.columns * DOTS]


def opencv_drawing(board, legacy):
    theirs = cv2.aruco.CharucoBoard(
        (board.columns, board.rows), 30.0, 22.0, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_250)
    )
    theirs.setLegacyPattern(legacy)
    return theirs.generateImage((board.columns * DOTS, board.rows * DOTS))


@pytest.fixture(scope="module")
def drawn():
    return drawing(BOARD)


@pytest.fixture(scope="module")
def pose():
    return next(boards.poses(BOARD, 1, seed=4))


@pytest.fixture(scope="module")
def picture(drawn, pose):
    return boards.photograph(drawn, BOARD, boards.LEFT, *pose)


@pytest.fixture(scope="module")
def truth(pose):
    return boards.project(BOARD, boards.LEFT, *pose)


def rms(view, truth):
    return np.sqrt(np.mean((view.corners - truth[view.ids]) ** 2))


def test_the_whole_board(picture, truth):
    view = BOARD.find(picture)
    assert view.ids.tolist() == list(range(35))
    assert view.corners.dtype == np.float32 and view.ids.dtype == np.int32
    assert rms(view, truth) < 0.06
    assert np.abs(view.corners - truth).max() < 0.2


@pytest.mark.parametrize("turn", [1, 2, 3])
def test_the_markers_tell_which_corner_is_the_first(picture, turn):
    straight = BOARD.find(picture).corners
    view = BOARD.find(np.ascontiguousarray(np.rot90(picture, turn)))
    assert view.ids.tolist() == list(range(35))
    width, height = boards.SIZE
    x, y = straight.T
    turned = {1: (y, width - 1 - x), 2: (width - 1 - x, height - 1 - y), 3: (height - 1 - y, x)}[turn]
    np.testing.assert_allclose(view.corners, np.column_stack(turned), atol=0.1)


def test_a_part_of_the_board_counts(picture, truth):
    part = picture.copy()
    part[:, : int(truth[2, 0])] = 128  # a hand, a border
    view = BOARD.find(part)
    assert 6 <= len(view.ids) <= 25
    assert (np.diff(view.ids) > 0).all()
    assert rms(view, truth) < 0.08


def test_too_little_to_count(picture, truth):
    row = np.full_like(picture, 128)
    top = int(truth[7:14, 1].mean())
    row[top - 20 : top + 20] = picture[top - 20 : top + 20]
    assert BOARD.find(row) is None  # corners in one line fix no plane
    for shape in ((1, 1), (3, 3), (3, 5000), (5000, 3)):
        assert BOARD.find(np.zeros(shape, np.uint8)) is None
        assert BOARD.hint(np.zeros(shape, np.uint8), None) is None
        assert sg.Board(8, 6, 30.0).hint(np.zeros(shape, np.uint8), None) is None
    assert BOARD.find(np.full((360, 480), 200, np.uint8)) is None
    noise = np.random.default_rng(0).integers(0, 255, (240, 320), np.uint8)
    assert BOARD.find(noise) is None


@pytest.mark.parametrize(
    "change",
    [lambda p: p.astype(np.uint16) * 16, lambda p: np.dstack([p, p, p // 2]), lambda p: (p // 4 + 20).astype(np.uint8)],
    ids=["12 bits", "colour", "dim"],
)
def test_other_kinds_of_pictures(picture, truth, change):
    view = BOARD.find(change(picture))
    assert len(view.ids) == 35
    assert rms(view, truth) < 0.15


def test_a_large_picture_is_placed_at_full_size(picture, truth):
    large = cv2.resize(picture, None, fx=5, fy=5, interpolation=cv2.INTER_CUBIC)
    view = BOARD.find(large)
    assert len(view.ids) == 35
    assert np.sqrt(np.mean((view.corners - ((truth + 0.5) * 5 - 0.5)) ** 2)) < 0.4  # 0.08 px of the small one


@pytest.mark.parametrize("rows", [6, 7])
@pytest.mark.parametrize("legacy", [False, True])
def test_both_layouts_of_opencv(rows, legacy):
    board = CharucoBoard(8, rows, 30.0, 22.0)
    pose = next(boards.poses(board, 1, seed=4))
    view = board.find(boards.photograph(opencv_drawing(board, legacy), board, boards.LEFT, *pose))
    assert len(view.ids) >= 0.9 * len(board.points)  # a marker that is missed takes two corners with it
    assert rms(view, boards.project(board, boards.LEFT, *pose)) < 0.06
    assert view.legacy is (legacy and rows == 6)  # with an odd number of rows they are one and the same


def test_our_print_is_what_opencv_draws(drawn):
    theirs = opencv_drawing(BOARD, False)
    assert np.mean(theirs != drawn) < 0.02  # a marker's cells fall on whole dots in one way or another


@pytest.mark.parametrize("rows", [6, 7])
def test_marker_squares_are_opencvs(rows):
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_250)
    for legacy in (False, True):
        theirs = cv2.aruco.CharucoBoard((8, rows), 1.0, 0.7, dictionary)
        theirs.setLegacyPattern(legacy)
        places = [np.floor(np.mean(outline, axis=0))[:2].astype(int).tolist() for outline in theirs.getObjPoints()]
        assert marker_squares(8, rows, legacy).tolist() == places


def test_calibration_with_boards_that_are_seen_in_part(drawn):
    left, right = [], []
    for number, pose in enumerate(boards.poses(BOARD, 9, seed=8)):
        left.append(boards.photograph(drawn, BOARD, boards.LEFT, *pose, seed=2 * number))
        second = boards.moved(*pose, ROTATION, SHIFT)
        right.append(boards.photograph(drawn, BOARD, boards.RIGHT, *second, seed=2 * number + 1))
    cut = int(np.mean(BOARD.find(left[2]).corners[:, 0]))
    left[2][:, :cut] = 128
    right[5][: int(np.mean(BOARD.find(right[5]).corners[:, 1]))] = 128
    rig = sg.calibrate(left, right, BOARD, coefficients=5)
    assert all(view.used for view in rig.views)
    assert rig.rms_px < 0.1
    np.testing.assert_allclose(rig.T, SHIFT, atol=0.6)
    assert np.rad2deg(np.linalg.norm(cv2.Rodrigues(rig.R @ ROTATION.T)[0])) < 0.15


def test_boards_of_which_too_little_is_seen(picture, truth):
    part = picture.copy()
    part[:, : int(truth[5, 0])] = 128
    assert BOARD.find(part) is None
    pair = find_pairs([picture] * 3 + [part], [picture] * 4, BOARD, None)[0][3]
    assert pair.reason == "too little of the board in the left picture"
    with pytest.raises(CalibrationError, match=r"0 of 3 pairs show enough of a board .*let both cameras see the same"):
        find_pairs([part] * 3, [picture] * 3, BOARD, None)


@pytest.mark.parametrize(
    ("named", "told"),
    [
        (
            CharucoBoard(8, 6, 30, 22, "4x4_50"),
            r"found markers of dictionary 5x5_50, not 4x4_50: say --dictionary 5x5_50",
        ),
        (CharucoBoard(8, 6, 30, 22, "apriltag_36h11"), r"not apriltag_36h11: say --dictionary 5x5_50"),
        (CharucoBoard(6, 8, 30, 22), r"found ids up to 23 that stand as on a board 8 squares wide: say 8x6"),
        (CharucoBoard(9, 6, 30, 22), r"found ids up to 23 that stand as on a board 8 squares wide: say 8x6"),
        (CharucoBoard(8, 5, 30, 22), r"found ids up to 23, which a 8x5 board does not have \(0 to 19\): say 8x6"),
        (CharucoBoard(8, 6, 30, 12), r"found markers whose side is 0\.7\d of a square's, not 0\.40"),
    ],
    ids=["dictionary", "april", "swapped", "columns", "rows", "marker"],
)
def test_another_board_is_named(picture, named, told):
    with pytest.raises(CalibrationError, match=told):
        sg.calibrate([picture] * 3, [picture] * 3, named)


def test_a_mirrored_picture_is_named(picture):
    mirrored = np.ascontiguousarray(picture[:, ::-1])
    assert BOARD.find(mirrored) is None
    assert "mirrored: turn mirroring off" in BOARD.hint(mirrored, None).text


def test_a_board_with_and_without_markers_is_named(picture):
    plain = sg.Board(8, 6, 30.0)
    photo = boards.render(plain, boards.LEFT, *next(boards.poses(plain, 1, seed=4)))
    assert BOARD.find(photo) is None
    assert "a plain checkerboard of 8x6 squares and no markers: leave out --marker" in BOARD.hint(photo, None).text
    told = sg.Board(7, 5, 30.0).hint(picture, None).text
    assert "found a ChArUco board with markers of dictionary 5x5_50: say --board 8x6 --dictionary 5x5_50" in told


def test_a_corner_that_is_off_is_left_out(truth):
    places = np.column_stack([np.arange(35) % 7, np.arange(35) // 7])
    corners = truth.astype(np.float32)
    assert fits_neighbours(corners, places).all()
    corners[[0, 17]] += (3.0, -2.0)
    np.testing.assert_array_equal(np.flatnonzero(~fits_neighbours(corners, places)), [0, 17])
    assert fits_neighbours(corners[:7], places[:7]).all()  # in one line nothing can be said


def test_markers_close_to_the_corners():
    board = CharucoBoard(8, 6, 30.0, 27.0)
    pose = next(boards.poses(board, 1, seed=4))
    view = board.find(boards.photograph(drawing(board), board, boards.LEFT, *pose))
    assert len(view.ids) >= 30
    assert rms(view, boards.project(board, boards.LEFT, *pose)) < 0.3


def test_the_board_that_is_meant_gives_no_hint(picture):
    assert BOARD.hint(picture, BOARD.find(picture)) is None
    assert BOARD.hint(np.full_like(picture, 90), None) is None


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ((8, 6, 30, 30), "marker is 30"),
        ((8, 6, 30, 0), "marker is 0"),
        ((8, 6, 30, float("nan")), "marker is nan"),
        ((8, 6, 30, "wide"), "marker is 'wide'"),
        ((8, 6, 30, 22, "8x8_50"), "dictionary '8x8_50': give one of 4x4_50"),
        ((8, 6, 30, 22, 5), "dictionary 5: give one of"),
        ((20, 20, 30, 22, "4x4_50"), "a 20x20 board has 200 markers, dictionary 4x4_50 has 50"),
        ((3, 6, 30, 22), "columns is 3"),
        ((8, 6, -1, 22), "square is -1"),
    ],
)
def test_no_such_board(values, told):
    with pytest.raises(InputError, match=re.escape(told)):
        CharucoBoard(*values)


def test_names_of_dictionaries():
    assert CharucoBoard(8, 6, 30, 22, " DICT_5X5_250 ") == BOARD
    assert CharucoBoard(8, 6, 3, 2.2, "apriltag_36h11", "cm").dictionary == "apriltag_36h11"
    assert BOARD.turns == (0,) and isinstance(BOARD, sg.Board)
