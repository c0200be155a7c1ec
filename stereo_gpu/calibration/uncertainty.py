"""How certain a fit is: the covariance of what all views share, and of depths measured with it.

The covariance is the inverse of the information in the corners, with the poses free, times the variance of a
corner's coordinates as the residuals give it (Hartley and Zisserman, "Multiple View Geometry", 2003, section 5.2).
It knows what noise does; it does not know a bent board or a square that was measured wrongly.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from stereo_gpu.calibration.bundle import (
    PINHOLE,
    POSE,
    Bundle,
    Corners,
    Normal,
    jacobian,
    lens_matrix,
    linearise,
    project,
    scaled_inverse,
)
from stereo_gpu.deviations import CameraDeviations, Deviations
from stereo_gpu.types import Doubles

GRID = (0.1, 0.3, 0.5, 0.7, 0.9)  # of the left picture's width and height, where depth is looked at


def corner_variance(normal: Normal, corners: int) -> float:
    """Variance of a corner's coordinates, px², from the residuals; `corners` is their number in both pictures."""
    views, shared = normal.gradient.shape
    free: int = 2 * corners - shared - POSE * views
    return normal.squares / max(1, free)


def shared_covariance(normal: Normal, corners: int) -> Doubles:
    """(P, P) covariance of the numbers that all views share; R's is that of a small turn after it.

    Raises:
        CalibrationError: something was not seen at all.
    """
    information, _ = normal.reduced()
    return corner_variance(normal, corners) * scaled_inverse(information.sum(axis=0))


def focal_share(lens: Doubles, rotations: Doubles, translations: Doubles, corners: Corners) -> float:
    """Deviation of one camera's focal length, as a share of it, from its own views alone.

    Not from `cv2.calibrateCameraExtended`, which calls a focal length certain that nothing determines.

    Args:
        lens: (4 + n,) of the camera.
        rotations, translations: (views, 3, 3) and (views, 3), board to camera frame.
        corners: what it saw.
    """
    nothing = Corners(corners.view[:0], corners.points[:0], corners.seen[:0])
    alone = Bundle((lens, lens), np.eye(3), np.zeros(3), rotations, translations)
    normal = linearise(alone, (corners, nothing))
    information = normal.reduced()[0].sum(axis=0)[: len(lens), : len(lens)]
    free = 2 * len(corners.seen) - len(lens) - POSE * len(rotations)
    covariance = normal.squares / max(1, free) * scaled_inverse(information)
    return float(np.sqrt(np.diag(covariance)[:2] / lens[:2] ** 2).max())


def find_deviations(bundle: Bundle, covariance: Doubles) -> Deviations:
    """Standard deviations of every parameter of the rig, R's in the rotation vector."""
    size = len(covariance)
    by_turn = np.eye(size)
    by_turn[-6:-3, -6:-3] = _vector_by_turn(cv2.Rodrigues(bundle.R)[0].reshape(3))
    deviations = np.sqrt(np.diag(by_turn @ covariance @ by_turn.T))
    first = len(bundle.lenses[0])
    left, right = (
        CameraDeviations(fx=part[0], fy=part[1], cx=part[2], cy=part[3], distortion=part[PINHOLE:])
        for part in (deviations[:first], deviations[first:-6])
    )
    return Deviations(left=left, right=right, om=deviations[-6:-3], T=deviations[-3:])


def working_places(bundle: Bundle, sizes: Sequence[tuple[int, int]], distances: Sequence[float]) -> Doubles:
    """(k, 3) places all over the left picture, at these distances along z, that the right camera sees as well."""
    width, height = sizes[0]
    pixels = np.array([(x * width, y * height) for y in GRID for x in GRID])
    lens = bundle.lenses[0]
    rays = cv2.undistortPoints(pixels.reshape(-1, 1, 2), lens_matrix(lens), lens[PINHOLE:]).reshape(-1, 2)
    places = np.concatenate([distance * np.column_stack([rays, np.ones(len(rays))]) for distance in distances])
    still, corners = _points(bundle, places)
    seen = project(still, corners, 1)[0]
    inside = ((seen >= 0) & (seen < sizes[1])).all(axis=1)
    return places[inside] if inside.any() else places


def depth_slopes(bundle: Bundle, places: Doubles) -> Doubles:
    """(k, P): how the depth of a point, triangulated from its two pixels, changes with the shared numbers."""
    still, corners = _points(bundle, places)
    by_shared, by_place = [], []
    for side in (0, 1):
        _, shared, pose = jacobian(still, corners, side)
        by_shared.append(shared)
        by_place.append(pose[:, :, 3:])
    # The pixels stay where they are: what the shared numbers move, the place makes good, in least squares.
    moved = -np.linalg.pinv(np.concatenate(by_place, axis=1)) @ np.concatenate(by_shared, axis=1)
    slopes: Doubles = moved[:, 2]
    return slopes


def depth_deviations(slopes: Doubles, covariance: Doubles) -> Doubles:
    """(k,) standard deviations of the depths that have these slopes."""
    deviations: Doubles = np.sqrt(np.einsum("kp,kp->k", slopes @ covariance, slopes))
    return deviations


def _points(bundle: Bundle, places: Doubles) -> tuple[Bundle, Corners]:
    """A bundle whose only view is the left camera's frame, and the places as its corners."""
    still = Bundle(bundle.lenses, bundle.R, bundle.T, np.eye(3)[None], np.zeros((1, 3)))
    return still, Corners(np.zeros(len(places), np.int32), places, np.zeros((len(places), 2)))


def _vector_by_turn(vector: Doubles) -> Doubles:
    """(3, 3) derivative of a rotation vector by a small turn after it: the inverse of the left Jacobian of SO(3)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    factor = 1 / 12 if angle < 1e-4 else (1 - angle / 2 / np.tan(angle / 2)) / angle**2
    derivative: Doubles = np.eye(3) - skew / 2 + factor * skew @ skew
    return derivative
