"""A board that is carried through the view of two cameras, for the tests of the capture."""

import cv2
import numpy as np

from stereo_gpu.boards.board import Board
from stereo_gpu.recording.frames import StereoFrame
from stereo_gpu.scene import build_scene, project

BOARD = Board(columns=10, rows=7, square=30.0)
SIZE = (640, 480)
RATE = 30.0
SCENE = build_scene(SIZE)
SQUARE_PX = 40  # of the drawing that is laid into the pictures


def checkerboard():
    """The board with a white margin of half a square, (H, W) uint8."""
    squares = (np.add.outer(np.arange(BOARD.rows), np.arange(BOARD.columns)) % 2 * 210 + 25).astype(np.uint8)
    return _with_margin(squares.repeat(SQUARE_PX, axis=0).repeat(SQUARE_PX, axis=1))


def charuco():
    """The same squares with markers of 0.7 of a square."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_250)
    board = cv2.aruco.CharucoBoard((BOARD.columns, BOARD.rows), 1.0, 0.7, dictionary)
    return _with_margin(board.generateImage((BOARD.columns * SQUARE_PX, BOARD.rows * SQUARE_PX), marginSize=0))


def _with_margin(squares):
    return cv2.copyMakeBorder(squares, *[SQUARE_PX // 2] * 4, cv2.BORDER_CONSTANT, value=235)


DRAWING = checkerboard()


def pose(number, shift=(0.0, 0.0)):
    """Board to left camera, one of fifteen that fill the view; moved by so many mm right and down."""
    rotation, translation = SCENE.board_poses[number]
    return rotation, translation + np.array([*shift, 0.0])


def between(one, other, share):
    """A pose on the way from one to another."""
    turn = cv2.Rodrigues(cv2.Rodrigues(other[0] @ one[0].T)[0] * share)[0]
    return turn @ one[0], one[1] + (other[1] - one[1]) * share


def render(place, blur=1, soft=0.8, drawing=DRAWING):
    """(left, right) pictures, (H, W, 3) uint8; blurred by `blur` px along the row, as by a move, and by the lens."""
    pictures = []
    for side, camera in enumerate((SCENE.rig.left, SCENE.rig.right)):
        rotation, translation = place
        if side:
            rotation, translation = SCENE.rig.R @ rotation, SCENE.rig.R @ translation + SCENE.rig.T
        height, width = drawing.shape
        pixels = np.float32([[0, 0], [width, 0], [width, height], [0, height]]) - 0.5
        # The drawing's half square of margin and the first square lie before the first inner corner.
        on_board = ((pixels + 0.5) / SQUARE_PX - 1.5) * BOARD.square
        corners = project(camera, np.column_stack([on_board, np.zeros(4)]) @ rotation.T + translation)
        home = cv2.getPerspectiveTransform(pixels, corners.astype(np.float32))
        laid = cv2.warpPerspective(drawing, home, SIZE, flags=cv2.INTER_AREA)
        inside = cv2.warpPerspective(np.full_like(drawing, 255), home, SIZE)
        rows = np.linspace(90, 130, SIZE[1])[:, None]
        grey = np.where(inside > 127, laid, rows)
        grey = cv2.GaussianBlur(cv2.blur(grey, (blur, 1)), (0, 0), soft)
        noisy = grey + np.random.default_rng(side).normal(0, 1.5, grey.shape)
        pictures.append(np.dstack([np.clip(noisy, 0, 255).astype(np.uint8)] * 3))
    return tuple(pictures)


def frame(number, pictures):
    """The moment of this number, 30 a second."""
    return StereoFrame(
        number=number, left=pictures[0], right=pictures[1], left_s=number / RATE, right_s=number / RATE + 0.002
    )
