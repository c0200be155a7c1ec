"""Pictures of a checkerboard with known truth, for the tests of the calibration."""

import cv2
import numpy as np

SIZE = (480, 360)


def lens(focal, cx, cy, distortion):
    return np.array([[focal, 0, cx], [0, focal * 1.01, cy], [0, 0, 1]]), np.array(distortion, np.float64)


LEFT = lens(420.0, 243.0, 176.0, [-0.21, 0.08, 0.0008, -0.0005, 0.02])
RIGHT = lens(428.0, 236.0, 183.0, [-0.19, 0.06, -0.0006, 0.0007, 0.01])


def poses(board, count, seed, turned=0.0):
    """Rotation vectors and translations of boards that fill the view in turn, board to left camera."""
    random = np.random.default_rng(seed)
    middle = np.array([(board.columns - 2) / 2, (board.rows - 2) / 2, 0]) * board.square
    for _ in range(count):
        tilt = cv2.Rodrigues(random.uniform(-0.45, 0.45, 3))[0]
        turn = cv2.Rodrigues(np.array([0, 0, turned]))[0]
        rotation = tilt @ turn
        # The board takes about half of the picture's width, and stays in the view of a camera to the right.
        z = board.columns * board.square * 420 / (SIZE[0] * 0.52)
        place = np.array([random.uniform(-0.08, 0.2) * z, random.uniform(-0.1, 0.1) * z, z])
        yield cv2.Rodrigues(rotation)[0], place - rotation @ middle


def places(board, camera, rotation_vector, translation):
    """Where on the board each pixel looks, (H, W, 2) in squares from the top left corner of its print."""
    matrix, distortion = camera
    width, height = SIZE
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(np.float64)
    rays = cv2.undistortPoints(pixels.reshape(-1, 1, 2), matrix, distortion).reshape(-1, 2)
    rotation = cv2.Rodrigues(rotation_vector)[0]
    # The plane's homography: (x, y, 1) on the board lies on the ray (u, v, 1).
    home = np.linalg.inv(np.column_stack([rotation[:, 0], rotation[:, 1], translation]))
    on_board = np.column_stack([rays, np.ones(len(rays))]) @ home.T
    return (on_board[:, :2] / on_board[:, 2:]).reshape(height, width, 2) / board.square + 1


def render(board, camera, rotation_vector, translation, seed=0):
    """A noisy grey picture of the board, (H, W) uint8; its edges are as sharp as pixels allow."""
    place = places(board, camera, rotation_vector, translation)
    waves = []
    for along in (place[..., 0], place[..., 1]):
        edge = np.rint(along)
        distance_px = (along - edge) / np.hypot(*np.gradient(along))
        waves.append(np.clip(2 * distance_px, -1, 1) * np.where(edge % 2 == 0, 1, -1))
    value = 125 - 85 * waves[0] * waves[1]
    outside = np.abs(place - np.array([board.columns, board.rows]) / 2) - np.array([board.columns, board.rows]) / 2
    value[outside.max(axis=-1) > 0] = 210
    value[outside.max(axis=-1) > 1] = 110
    value += np.random.default_rng(seed).normal(0, 1.5, value.shape)
    return np.clip(np.rint(value), 0, 255).astype(np.uint8)


def photograph(drawn, board, camera, rotation_vector, translation, seed=0):
    """A noisy grey picture of a drawing of the board, whose edges are those of its outer squares."""
    place = places(board, camera, rotation_vector, translation)
    fine = cv2.resize(place, None, fx=4, fy=4, interpolation=cv2.INTER_LINEAR)
    dots = (fine * (drawn.shape[1] / board.columns, drawn.shape[0] / board.rows) - 0.5).astype(np.float32)
    seen = cv2.remap(
        drawn, dots[..., 0], dots[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=255
    )
    seen = cv2.resize(seen, SIZE, interpolation=cv2.INTER_AREA)
    value = 40 + seen * (170 / 255) + np.random.default_rng(seed).normal(0, 1.5, seen.shape)
    return np.clip(np.rint(value), 0, 255).astype(np.uint8)


def project(board, camera, rotation_vector, translation):
    """Where the inner corners are in the picture, (N, 2)."""
    points = board.points.astype(np.float64)
    return cv2.projectPoints(points, rotation_vector, translation, *camera)[0].reshape(-1, 2)


def moved(rotation_vector, translation, rotation, shift):
    """The board's pose in the right camera's frame."""
    left = cv2.Rodrigues(rotation_vector)[0]
    return cv2.Rodrigues(rotation @ left)[0], rotation @ translation + shift
