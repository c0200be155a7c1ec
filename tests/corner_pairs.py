"""Board pairs as the finder would give them, made without pictures: corners with known truth and known noise."""

import boards
import cv2
import numpy as np

from stereo_gpu.boards.board import Board, BoardView
from stereo_gpu.boards.board_pairs import BoardPair
from stereo_gpu.calibration.bundle import Bundle, Corners, project

BOARD = Board(columns=9, rows=7, square=30.0)  # both odd: turned by 180 degrees it looks the same
SIZES = [boards.SIZE, boards.SIZE]
ROTATION = cv2.Rodrigues(np.array([0.02, -0.06, 0.01]))[0]
SHIFT = np.array([-60.0, 1.5, 2.0])
NOISE_PX = 0.1


def turned(degrees, about=(0.0, 1.0, 0.0)):
    """The right camera turned by so much."""
    return cv2.Rodrigues(np.deg2rad(degrees) * np.array(about))[0] @ ROTATION


def held(count, seed, tilt=0.45, near=400.0, far=650.0):
    """Rotations (count, 3, 3) and translations (count, 3) of boards all over the view, board to left camera frame."""
    random = np.random.default_rng(seed)
    middle = np.array([(BOARD.columns - 2) / 2, (BOARD.rows - 2) / 2, 0]) * BOARD.square
    rotations = np.stack([cv2.Rodrigues(random.uniform(-tilt, tilt, 3))[0] for _ in range(count)])
    z = random.uniform(near, far, count)
    place = np.stack([random.uniform(-0.15, 0.25, count) * z, random.uniform(-0.15, 0.15, count) * z, z], axis=1)
    return rotations, place - rotations @ middle


def truth(count, seed, left=boards.LEFT, right=boards.RIGHT, rotation=ROTATION, shift=SHIFT, **how):
    """The true bundle of so many views."""
    lenses = tuple(np.array([k[0, 0], k[1, 1], k[0, 2], k[1, 2], *lens]) for k, lens in (left, right))
    return Bundle(lenses, rotation, shift, *held(count, seed, **how))


def corners_of(bundle, seed=None, noise=NOISE_PX):
    """What both cameras see of the whole board in every view; without a seed with no noise."""
    views, points = len(bundle.rotations), BOARD.points.astype(np.float64)
    where = Corners(
        np.repeat(np.arange(views, dtype=np.int32), len(points)),
        np.tile(points, (views, 1)),
        np.zeros((views * len(points), 2)),
    )
    random = np.random.default_rng(seed)
    both = []
    for side in (0, 1):
        seen = project(bundle, where, side)[0]
        if seed is not None:
            seen = seen + random.normal(0, noise, seen.shape)
        both.append(Corners(where.view, where.points, seen))
    return tuple(both)


def as_pairs(corners):
    """The same as the pairs that `find_pairs` gives."""
    pairs = []
    for number in range(int(corners[0].view[-1]) + 1):
        views = [BoardView.whole(ours.seen[ours.view == number].astype(np.float32)) for ours in corners]
        pairs.append(BoardPair((f"left{number + 1:02d}.png", f"right{number + 1:02d}.png"), number + 1, views))
    return pairs


def pairs(count=12, seed=1, noise=NOISE_PX, **how):
    """Board pairs with noise."""
    return as_pairs(corners_of(truth(count, seed, **how), seed, noise))
