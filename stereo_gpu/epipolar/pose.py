"""How two cameras of known lenses stand to each other, from matched points of what they see."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from stereo_gpu.epipolar.points import check_points, cross_matrix, homogeneous, sampson_distances
from stereo_gpu.epipolar.robust import (
    CONFIDENCE,
    MOST_TRIALS,
    ROUNDING,
    START_PX,
    WIDEST_PX,
    WITHIN,
    Fit,
    best_of,
    fit_robustly,
)
from stereo_gpu.errors import InputError, StageError
from stereo_gpu.rig import Camera
from stereo_gpu.types import Doubles

FEWEST = 8  # the five-point algorithm takes five; three more tell whether they are right
LEAST_PARALLAX = 3.0  # a turn alone must misfit this many times worse than a turn and a shift
CLOSE = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 1e-10)  # where undistortion ends, px


class Pose(NamedTuple):
    """How two cameras stand to each other: X_right = R X_left + t, up to the scale of t.

    Args:
        R: (3, 3) rotation.
        t: (3,) of length 1.
        inliers: (N,) which matches fit it and lie in front of both cameras.
    """

    R: Doubles
    t: Doubles
    inliers: NDArray[np.bool_]


def estimate_pose(points_left: ArrayLike, points_right: ArrayLike, camera_left: Camera, camera_right: Camera) -> Pose:
    """Find rotation and direction of translation between two calibrated cameras.

    The points are undistorted; an essential matrix comes from five points at a time (Nister 2004) with MAGSAC++
    (Barath et al. 2020), both in OpenCV; of its four poses that one is taken which puts most points in front of both
    cameras (Hartley and Zisserman, section 9.6); then the Sampson distances are made least over the 5 parameters,
    with Cauchy's loss and noise found from the points. Points in a plane will do; a line will not.

    Args:
        points_left, points_right: (N, 2) px as the cameras saw them, N >= 8; some may be wrong.
        camera_left, camera_right: of known matrix and distortion.

    Raises:
        InputError: the points are no such points, or the cameras no cameras.
        StageError: no pose fits enough of them, or the camera only turned, so that t has no direction.
    """
    for name, camera in (("camera_left", camera_left), ("camera_right", camera_right)):
        if not isinstance(camera, Camera):
            raise InputError(f"{name} is a {type(camera).__name__}: give a Camera, such as rig.left")
    left, right = check_points(points_left, points_right, FEWEST)
    rays_left, rays_right = undistort(left, camera_left), undistort(right, camera_right)
    focal = typical_focal(camera_left, camera_right)
    starts = first_poses(rays_left, rays_right, focal)
    # Of wrong matches only those take part that one of the first poses holds for right.
    near = np.any([np.abs(pose_distances(*pose, rays_left, rays_right, focal)) < WIDEST_PX for pose in starts], axis=0)
    if int(near.sum()) < FEWEST:
        raise StageError(f"no pose fits {FEWEST} of {len(left)} matches: give pictures that show the same things")
    # Poses far apart can fit nearly as well where most of the points lie in a plane: so all of them are refined.
    (R, t), fit = best_of([refine_pose(*pose, rays_left[near], rays_right[near], focal) for pose in starts])
    noise = max(fit.noise, ROUNDING * focal)
    # What is so far away that noise may put it behind the cameras is no contradiction.
    ahead = focal * inverse_depths(R, t, rays_left, rays_right) > -WITHIN * noise
    agree = ahead & (np.abs(pose_distances(R, t, rays_left, rays_right, focal)) <= WITHIN * noise)
    if int(agree.sum()) < FEWEST:
        raise StageError(
            f"the pose fits {int(agree.sum())} of {len(left)} matches, {FEWEST} are needed:"
            " give pictures that show the same things"
        )
    turn_px = focal * misfit_of_turn(rays_left[agree], rays_right[agree])
    if turn_px <= LEAST_PARALLAX * noise:
        raise StageError(
            f"the cameras only turned: that alone fits {int(agree.sum())} matches to {turn_px:.2g} px, so that the"
            " translation has no direction; move the cameras apart, or closer to the scene"
        )
    return Pose(R, t, agree)


def undistort(points: Doubles, camera: Camera) -> Doubles:
    """(N, 2) px to (N, 2) x / z, y / z in the camera's frame.

    Fast enough for the inside of a fit; `rows.rays` tells besides where the lens model has no direction.
    """
    if not len(points):  # of which OpenCV makes None
        return points
    # In the corners of a wide lens OpenCV's own five steps end 0.02 px off.
    rays: Doubles = cv2.undistortPoints(points[:, None], camera.matrix, camera.distortion, criteria=CLOSE)[:, 0]
    return rays


def typical_focal(camera_left: Camera, camera_right: Camera) -> float:
    """Mean focal length of both cameras, px: what one unit of x / z is worth."""
    return float(np.mean([camera.matrix[axis, axis] for camera in (camera_left, camera_right) for axis in (0, 1)]))


def inverse_depths(R: Doubles, t: Doubles, rays_left: Doubles, rays_right: Doubles) -> Doubles:
    """(N,) one over the depth in the left camera, in lengths of t; below zero for what would lie behind it."""
    left, right = homogeneous(rays_left) @ R.T, homogeneous(rays_right)
    # z R x_left + t is along x_right, so that z (x_right x R x_left) = -(x_right x t).
    moved, shift = np.cross(right, left), np.cross(right, t)
    inverse: Doubles = -(moved * shift).sum(axis=1) / np.maximum((shift**2).sum(axis=1), np.finfo(np.float64).tiny)
    return inverse


def poses_near(R: Doubles, t: Doubles) -> Callable[[Doubles], tuple[Doubles, Doubles]]:
    """A function from 5 parameters to (R, t), t of length 1; zeros give the ones here.

    Three turn R, two move t in the plane across it.
    """
    across = np.linalg.svd(t.reshape(1, 3))[2][1:].T

    def compose(parameters: Doubles) -> tuple[Doubles, Doubles]:
        moved = t + across @ parameters[3:5]
        return cv2.Rodrigues(parameters[:3])[0] @ R, moved / np.linalg.norm(moved)

    return compose


def first_poses(rays_left: Doubles, rays_right: Doubles, focal: float) -> list[tuple[Doubles, Doubles]]:
    """Poses by MAGSAC++ with several thresholds, and that of two cameras side by side."""
    poses = [(np.eye(3), np.array([-1.0, 0, 0]))]
    for threshold in START_PX:
        try:
            essential, agreeing = cv2.findEssentialMat(
                rays_left, rays_right, np.eye(3), cv2.USAC_MAGSAC, CONFIDENCE, threshold / focal, MOST_TRIALS
            )
        except cv2.error:  # some versions fail on matches that no pose fits
            continue
        if essential is not None and essential.shape == (3, 3) and np.isfinite(essential).all():
            agree = agreeing.ravel() > 0
            poses.append(_most_in_front(essential, rays_left[agree], rays_right[agree]))
    return poses


def _most_in_front(essential: Doubles, rays_left: Doubles, rays_right: Doubles) -> tuple[Doubles, Doubles]:
    """Of the four poses of an essential matrix the one that puts most points in front of both cameras."""
    first, second, shift = cv2.decomposeEssentialMat(essential)
    poses = [(R, sign * shift.ravel()) for R in (first, second) for sign in (1.0, -1.0)]

    def in_front(pose: tuple[Doubles, Doubles]) -> int:
        R, t = pose
        seen_left = inverse_depths(R, t, rays_left, rays_right) > 0
        seen_right = inverse_depths(R.T, -R.T @ t, rays_right, rays_left) > 0
        return int((seen_left & seen_right).sum())

    return max(poses, key=in_front)


def pose_distances(R: Doubles, t: Doubles, rays_left: Doubles, rays_right: Doubles, focal: float) -> Doubles:
    """(N,) Sampson distances, px."""
    return focal * sampson_distances(cross_matrix(t) @ R, rays_left, rays_right)


def refine_pose(
    R: Doubles, t: Doubles, rays_left: Doubles, rays_right: Doubles, focal: float
) -> tuple[tuple[Doubles, Doubles], Fit]:
    """The pose of least Sampson distances near this one."""
    compose = poses_near(R, t)
    fit = fit_robustly(
        lambda trial: pose_distances(*compose(trial), rays_left, rays_right, focal), np.zeros(5), noise=START_PX[0]
    )
    R, t = compose(fit.parameters)
    # A plane also fits the pose of its twin, which puts a part of it behind a camera: that counts as misfit.
    behind = np.minimum(0, focal * inverse_depths(R, t, rays_left, rays_right))
    return (R, t), replace(fit, residuals=np.hypot(fit.residuals, behind))


def misfit_of_turn(rays_left: Doubles, rays_right: Doubles) -> float:
    """Angle, rms, radian a coordinate, between the right rays and the left ones after the best turn (Kabsch 1976)."""
    left, right = (homogeneous(rays) for rays in (rays_left, rays_right))
    left, right = (rays / np.linalg.norm(rays, axis=1, keepdims=True) for rays in (left, right))
    U, _, Vt = np.linalg.svd(right.T @ left)
    turn = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    off = right - left @ turn.T
    return float(np.sqrt((off**2).sum() / max(1, 2 * len(left) - 3)))
