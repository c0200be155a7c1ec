import boards
import cv2
import numpy as np
import pytest

from stereo_gpu.calibration.board import Board
from stereo_gpu.calibration.checkerboard import survey_checkerboard
from stereo_gpu.errors import InputError

BOARD = Board(columns=10, rows=7, square=30.0)


@pytest.fixture(scope="module")
def view():
    pose = next(boards.poses(BOARD, 1, seed=4))
    return boards.render(BOARD, boards.LEFT, *pose), boards.project(BOARD, boards.LEFT, *pose)


def either_way(corners, truth):
    """Largest distance, from whichever end the corners were listed."""
    return min(np.abs(corners - truth).max(), np.abs(corners[::-1] - truth).max())


def test_corners_and_points():
    assert BOARD.corners == (9, 6)
    assert BOARD.points.shape == (54, 3)
    assert BOARD.points.dtype == np.float32
    assert BOARD.points[1].tolist() == [30, 0, 0]
    assert BOARD.points[9].tolist() == [0, 30, 0]
    assert BOARD.points[-1].tolist() == [240, 150, 0]
    assert str(BOARD) == "10x7"


@pytest.mark.parametrize("text", ["10x7", " 10 X 7 ", "10×7"])
def test_parse(text):
    assert Board.parse(text, 30) == BOARD


@pytest.mark.parametrize("text", ["", "10", "10x", "x7", "10x7x3", "-10x7", "1e1x7", "10.5x7", "9" * 50 + "x7", "٣x7"])
def test_parse_refuses(text):
    with pytest.raises(InputError, match="such as 10x7"):
        Board.parse(text, 30)


@pytest.mark.parametrize(
    ("columns", "rows", "square", "told"),
    [
        (3, 7, 30, "columns is 3"),
        (10, -7, 30, "rows is -7"),
        (10.0, 7, 30, "columns is 10.0"),
        (True, 7, 30, "columns is True"),
        (10, 1000, 30, "rows is 1000"),
        (10, 7, 0, "square is 0"),
        (10, 7, -1, "square is -1"),
        (10, 7, float("nan"), "square is nan"),
        (10, 7, "wide", "square is 'wide'"),
        (10, 7, None, "square is None"),
    ],
)
def test_no_such_board(columns, rows, square, told):
    with pytest.raises(InputError, match=told):
        Board(columns, rows, square)


def test_corners_are_found_to_a_few_hundredths_of_a_pixel(view):
    picture, truth = view
    corners = BOARD.find(picture).corners
    assert corners.dtype == np.float32
    assert either_way(corners, truth) < 0.12  # noise of 2 grey values
    assert np.sqrt(np.mean((corners - truth) ** 2)) < 0.04 or np.sqrt(np.mean((corners[::-1] - truth) ** 2)) < 0.04


@pytest.mark.parametrize(
    "change",
    [
        lambda p: p.astype(np.uint16) * 16,  # 12 bits of 16
        lambda p: np.dstack([p, p, p // 2]),
        lambda p: (p // 8 + 20).astype(np.uint8),  # hardly any contrast
        lambda p: np.clip(p * np.linspace(0.15, 1.0, p.shape[1]), 0, 255).astype(np.uint8),  # lit from one side
    ],
    ids=["12 bits", "colour", "dim", "lit from the side"],
)
def test_other_kinds_of_pictures(view, change):
    picture, truth = view
    assert either_way(BOARD.find(change(picture)).corners, truth) < 0.6


def test_a_large_picture_is_refined_at_full_size(view):
    picture, truth = view
    large = cv2.resize(picture, None, fx=5, fy=5, interpolation=cv2.INTER_CUBIC)
    assert max(large.shape) > 1600
    assert either_way(BOARD.find(large).corners, (truth + 0.5) * 5 - 0.5) < 0.8  # 0.16 px of the small one


def test_corners_turn_clockwise(view):
    picture, _ = view
    for turned in (picture, np.rot90(picture), np.rot90(picture, 2), np.rot90(picture, 3)):
        grid = BOARD.find(np.ascontiguousarray(turned)).corners.reshape(6, 9, 2)
        along, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
        assert along[0] * down[1] - along[1] * down[0] > 0


def test_no_board():
    noise = np.random.default_rng(0).integers(0, 255, (120, 160), np.uint8)
    assert BOARD.find(noise) is None
    assert BOARD.find(np.zeros((3, 3), np.uint8)) is None
    assert survey_checkerboard(noise) is None
    assert survey_checkerboard(np.zeros((3, 3), np.uint8)) is None


def test_the_survey_says_which_board_it_is(view):
    assert survey_checkerboard(view[0]) == (10, 7)


def test_every_real_board_is_found(data):
    from stereo_gpu.images import read_image

    files = sorted((data / "calibration" / "board_10x7").glob("*.jpg"))
    assert len(files) == 26
    assert all(BOARD.find(read_image(file)) is not None for file in files)
