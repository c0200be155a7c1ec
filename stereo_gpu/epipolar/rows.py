"""On which rows a rig puts matched points of a raw pair: in a rectified pair both lie on one."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stereo_gpu.epipolar.points import cross_matrix
from stereo_gpu.rig import Camera, Rig
from stereo_gpu.types import Doubles

WIDEST = 10.0  # x / z: nearly 85 degrees off the axis, where no lens model of these holds
PASSES = 8  # of Newton's method
STEP, LEAP = 1e-5, 0.3  # in focal lengths: of the differences, and at most in one pass
EXACT_PX = 1e-3


@dataclass(frozen=True, kw_only=True)
class Rows:
    """Where a rig puts matched points, in px of a camera with the mean focal length of the two.

    Args:
        vertical: (N,) row in the left picture less row in the right one; 0 with a perfect rig.
        disparity: (N,) column in the left picture less column in the right one, 0 at infinity.
        at: (N, 2) place in the rectified left picture, in focal lengths from its principal point.
    """

    vertical: Doubles
    disparity: Doubles
    at: Doubles


def focal_length(rig: Rig) -> float:
    """Mean focal length of the two cameras along the rows' normal, px."""
    return float(rig.left.matrix[1, 1] + rig.right.matrix[1, 1]) / 2


def rays(points: Doubles, camera: Camera) -> Doubles:
    """(N, 2) directions x / z, y / z in the camera's frame, from (N, 2) px; NaN where the lens model has none."""
    if not len(points):
        return np.zeros((0, 2))
    # From OpenCV's fixed-point iteration by Newton's, which also reaches the corners of a strong lens model.
    found = cv2.undistortPoints(points.reshape(-1, 1, 2), camera.matrix, camera.distortion).reshape(-1, 2)
    plain = (points - camera.matrix[:2, 2]) / np.diag(camera.matrix)[:2]
    astray = ~(_miss(found, points, camera)[1] < _miss(plain, points, camera)[1])
    directions: Doubles = np.where(astray[:, None], plain, found)
    missed, off = _miss(directions, points, camera)
    for _ in range(PASSES):
        if (off < EXACT_PX).all():
            break
        slopes = np.stack(
            [(_miss(directions + step, points, camera)[0] - missed) / STEP for step in STEP * np.eye(2)], axis=2
        )
        steps = np.einsum("nij,nj->ni", np.linalg.pinv(slopes), missed)
        tried = np.clip(directions - np.clip(steps, -LEAP, LEAP), -WIDEST, WIDEST)
        tried_missed, tried_off = _miss(tried, points, camera)
        closer = tried_off < off
        directions = np.where(closer[:, None], tried, directions)
        missed, off = np.where(closer[:, None], tried_missed, missed), np.where(closer, tried_off, off)
    return np.where(off[:, None] < EXACT_PX, directions, np.nan)


def _miss(directions: Doubles, points: Doubles, camera: Camera) -> tuple[Doubles, Doubles]:
    """How far from `points` the camera sees directions, (N, 2) px, and the larger part of it, (N,)."""
    ahead = np.column_stack([np.clip(np.nan_to_num(directions), -WIDEST, WIDEST), np.ones(len(points))])
    seen = cv2.projectPoints(ahead, np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)[0].reshape(-1, 2)
    missed = np.nan_to_num(seen - points, nan=1e6, posinf=1e6, neginf=-1e6)
    return missed, np.abs(missed).max(axis=1)


def rectifying_rotations(rotation: Doubles, translation: Doubles) -> tuple[Doubles, Doubles]:
    """The two rotations (3, 3), raw camera frame to rectified one, by Bouguet's method, as cv2.stereoRectify's.

    Each camera turns by half of the rotation between them, then both turn so that T lies along x. Not by OpenCV, which
    takes an angle below 1e-5 for none: a fit would see no slope there.
    """
    # The half H of a rotation R = H H: I + R = H (H^T + H), whose second factor is symmetric and has no eigenvalue
    # below 0, so that H is the orthogonal one of the polar decomposition.
    left, _, right = np.linalg.svd(np.eye(3) + rotation)
    half = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    along = half.T @ translation
    # Rodrigues' formula for the shortest turn of `along` into the x axis, whose sine and cosine come of its products.
    length = float(np.linalg.norm(along))
    across = cross_matrix(np.cross(along, [np.copysign(1.0, along[0]), 0.0, 0.0])) / length
    level = np.eye(3) + across + across @ across / (1 + abs(along[0]) / length)
    return level @ half, level @ half.T


def find_rows(rays_left: Doubles, rays_right: Doubles, rotation: Doubles, translation: Doubles, focal: float) -> Rows:
    """Rectify matched rays, (N, 2) each, by X_right = rotation X_left + translation; `focal` in px sets the scale."""
    sides = []
    for directions, turn in zip((rays_left, rays_right), rectifying_rotations(rotation, translation), strict=True):
        turned = np.column_stack([directions, np.ones(len(directions))]) @ turn.T
        sides.append(turned[:, :2] / turned[:, 2:])
    apart = focal * (sides[0] - sides[1])
    return Rows(vertical=apart[:, 1], disparity=apart[:, 0], at=sides[0])
