import boards
import cv2
import numpy as np
import pytest

from stereo_gpu.boards.board import Board
from stereo_gpu.boards.checkerboard import survey_checkerboard
from stereo_gpu.boards.crossings import largest_grid
from stereo_gpu.boards.hints import Hint, common_hint
from stereo_gpu.errors import InputError
from stereo_gpu.images import read_image

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
        (10, 7, 1e300, "square is 1e"),
        (10, 7, 1e-300, "square is 1e-300"),
    ],
)
def test_no_such_board(columns, rows, square, told):
    with pytest.raises(InputError, match=told):
        Board(columns, rows, square)


def test_what_was_searched_before_changes_nothing(raw_folder):
    picture = read_image(raw_folder / "left.png")
    told = set()
    for seed in (-1, 0, 1):
        cv2.setRNGSeed(seed)
        told.add(survey_checkerboard(picture))
    assert len(told) == 1


@pytest.mark.parametrize("unit", ["", None, 25.4, "m" * 17, "m\n"])
def test_no_such_unit(unit):
    with pytest.raises(InputError, match="name a unit of length such as mm"):
        Board(10, 7, 30.0, unit)


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


def test_a_glance_tells_a_board_from_clutter(view):
    # All but the four ends are linked to two neighbours.
    assert 50 <= largest_grid(view[0], 1000) <= 60
    blurred = cv2.GaussianBlur(view[0], (0, 0), 3)
    assert largest_grid(blurred, 1000) >= 50
    random = np.random.default_rng(1)
    noise = random.integers(0, 255, (360, 480), np.uint8)
    assert largest_grid(noise, 1000) < 20
    assert largest_grid(cv2.GaussianBlur(noise, (0, 0), 4), 1000) < 20
    assert largest_grid(np.full((360, 480), 90, np.uint8), 1000) == 0
    stripes = np.tile(np.where(np.arange(480) % 40 < 20, 60, 190).astype(np.uint8), (360, 1))
    assert largest_grid(stripes, 1000) == 0


def test_real_pictures_without_a_board_are_refused_at_a_glance(data):
    from stereo_gpu.images import grey, read_image

    for name in ("teddy/im2.png", "motorcycle/motorcycle_left.png", "aloe_light/left.png", "tsukuba/im3.png"):
        assert largest_grid(grey(read_image(data / "stereo" / name)), 1000) < 30  # a 10x7 board asks for 35


def test_a_hint_needs_half_of_the_pictures():
    chance, other = Hint("4x4", "say 4x4"), Hint("rows", "found 7 rows", 7)
    assert common_hint([chance, None, None, None, chance]) == ""
    assert common_hint([None, None]) == ""
    assert common_hint([other, Hint("rows", "found 8 rows", 8), chance, other]) == "found 8 rows"
    assert common_hint([other, other, None], share=1.0) == ""


def test_pictures_without_a_board_suggest_none(data):
    from stereo_gpu.images import read_image

    clutter = [read_image(data / "stereo" / name) for name in ("aloe_light/left.png", "tsukuba/im3.png")]
    hints = [BOARD.hint(picture, None) for picture in clutter]
    assert common_hint([*hints, None, None, None]) == ""
    assert all(BOARD.find(picture) is None for picture in clutter)


def test_every_real_board_is_found(data):
    from stereo_gpu.images import read_image

    files = sorted((data / "calibration" / "board_10x7").glob("*.jpg"))
    assert len(files) == 26
    assert all(BOARD.find(read_image(file)) is not None for file in files)
