"""Points seen by two cameras, with known truth, for the tests of epipolar geometry."""

import cv2
import numpy as np

from stereo_gpu.rig import Camera, Rig

SIZE = (640, 480)
R = cv2.Rodrigues(np.array([0.02, -0.06, 0.015]))[0]
T = np.array([-0.5, 0.02, 0.03])


def camera(focal=520.0, lens=(0.0, 0.0, 0.0, 0.0, 0.0)):
    return Camera(np.array([[focal, 0, 322.5], [0, focal, 236.0], [0, 0, 1]]), np.array(lens), SIZE)


def rig(lens=(0.0, 0.0, 0.0, 0.0, 0.0)):
    return Rig(camera(520.0, lens), camera(530.0, lens), R, T, unit="m")


def fundamental(rig):
    x, y, z = rig.T
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ rig.R
    F = np.linalg.inv(rig.right.matrix).T @ essential @ np.linalg.inv(rig.left.matrix)
    return F / np.linalg.norm(F)


def see(rig, points, noise=0.0, seed=1):
    """(N, 2) px in either camera of (N, 3) points in the left camera's frame."""
    random = np.random.default_rng(seed)
    left = cv2.projectPoints(points, np.zeros(3), np.zeros(3), rig.left.matrix, rig.left.distortion)[0][:, 0]
    turn = cv2.Rodrigues(rig.R)[0]
    right = cv2.projectPoints(points, turn, rig.T, rig.right.matrix, rig.right.distortion)[0][:, 0]
    return left + random.normal(0, noise, left.shape), right + random.normal(0, noise, right.shape)


def room(count, seed=0, near=3.0, far=8.0):
    """(N, 3) points all over the view, between two depths."""
    random = np.random.default_rng(seed)
    z = random.uniform(near, far, count)
    return np.column_stack([random.uniform(-0.5, 0.5, count) * z, random.uniform(-0.4, 0.4, count) * z, z])


def wall(count, seed=0):
    """(N, 3) points on a slanted plane."""
    points = room(count, seed)
    points[:, 2] = 5 + 0.3 * points[:, 0] - 0.2 * points[:, 1]
    return points


def angle(one, other):
    """Degrees between two rotations, or between two directions."""
    if np.ndim(one) == 2:
        return np.degrees(np.linalg.norm(cv2.Rodrigues(one @ other.T)[0]))
    cosine = one @ other / np.linalg.norm(one) / np.linalg.norm(other)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def board_corners(folder, board, every=1):
    """Corners of every so many pairs of a folder, (N, 2) px left and right; nearness settles which end is first."""
    from stereo_gpu.images import read_image

    for left in sorted(folder.glob("left*.jpg"))[::every]:
        right = left.with_name(left.name.replace("left", "right"))
        seen = [board.find(read_image(path)) for path in (left, right)]
        if None not in seen:
            one, other = (view.corners.astype(float) for view in seen)
            turned = other[::-1]
            yield one, min((other, turned), key=lambda corners, one=one: np.abs(corners - one).sum())
