"""Edge widths against blurs of known size, and against OpenCV's own measure."""

import boards
import cv2
import numpy as np
import pytest

from stereo_gpu.boards.board import Board, BoardView
from stereo_gpu.boards.sharpness import edge_width

BOARD = Board(columns=10, rows=7, square=30.0)


@pytest.fixture(scope="module")
def board():
    pose = next(boards.poses(BOARD, 1, seed=4))
    return boards.render(BOARD, boards.LEFT, *pose), BoardView.whole(boards.project(BOARD, boards.LEFT, *pose))


def dragged(picture, length, across):
    """Blurred as by a move of `length` px."""
    return cv2.blur(picture, (length, 1) if across else (1, length))


def test_a_sharp_board_is_sharp(board):
    assert edge_width(*board, BOARD) < 2.2


@pytest.mark.parametrize("sigma", [1.0, 2.0, 3.0])
def test_a_gaussian_blur_has_its_textbook_width(board, sigma):
    blurred = cv2.GaussianBlur(board[0], (0, 0), sigma)
    assert edge_width(blurred, board[1], BOARD) == pytest.approx(2.563 * sigma, rel=0.08)  # 10 to 90 % of its integral


@pytest.mark.parametrize("across", [True, False])
@pytest.mark.parametrize("length", [5, 9])
def test_a_move_in_either_direction_shows(board, length, across):
    width = edge_width(dragged(board[0], length, across), board[1], BOARD)
    assert 0.65 * length < width < length + 1  # 0.8 of it where the move goes straight across


def test_wider_than_can_be_seen_is_still_wide(board):
    assert edge_width(cv2.GaussianBlur(board[0], (0, 0), 8), board[1], BOARD) > 8


def test_it_agrees_with_opencv(board):
    for sigma in (1.0, 1.5, 2.5):
        blurred = cv2.GaussianBlur(board[0], (0, 0), sigma)
        known = cv2.estimateChessboardSharpness(blurred, BOARD.corners, board[1].corners.reshape(-1, 1, 2))[0][0]
        assert edge_width(blurred, board[1], BOARD) == pytest.approx(known, rel=0.2)


def test_corners_half_a_pixel_off_do_no_harm(board):
    off = BoardView.whole(board[1].corners + np.float32([0.5, -0.4]))
    assert edge_width(board[0], off, BOARD) == pytest.approx(edge_width(*board, BOARD), abs=0.3)


def test_a_part_of_a_board_tells_too_and_nothing_tells_nothing(board):
    picture, view = board
    part = view.only(np.array([10, 11, 19, 20], np.int32))
    assert edge_width(picture, part, BOARD) == pytest.approx(edge_width(picture, view, BOARD), abs=0.4)
    assert np.isnan(edge_width(picture, view.only(np.array([0, 53], np.int32)), BOARD))
    assert np.isnan(edge_width(np.full_like(picture, 90), view, BOARD))


def test_real_boards_are_sharp(data):
    from stereo_gpu.images import grey, read_image

    for name in ("left01.jpg", "right09.jpg"):
        picture = read_image(data / "calibration" / "board_10x7" / name)
        assert 1.5 < edge_width(grey(picture), BOARD.find(picture), BOARD) < 3.2
