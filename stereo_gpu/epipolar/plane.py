"""Tell matched points from which no fundamental matrix follows: those in a plane, and those on a line."""

from __future__ import annotations

import cv2
import numpy as np

from stereo_gpu.epipolar.points import homogeneous, normaliser, sampson_distances
from stereo_gpu.errors import InputError
from stereo_gpu.types import Doubles

ROUNDING = 1e-6  # of the points' extent: nobody locates a point better, float32 does not hold it better
THIN = 1e-3  # width to length of a set of points that is a line
LEAST_DEPTH = 3.5  # a plane must misfit this many times worse than F: 42 single boards reach 2.7, two boards 6.4
SIGNIFICANT = 0.9  # and by more than chance explains so often, where there are few points
ANY_PLANE = 0.02  # of the extent: what misfits more is no plane but wrong matches
LENS_POINTS = 25  # from which on the lenses' distortion is fitted too
STEPS = 6  # of Gauss and Newton's method


def refuse_degenerate(points_left: Doubles, points_right: Doubles, F: Doubles) -> None:
    """Make sure that the points reach far enough out of any plane for `F` to follow from them.

    Points of a plane are carried from one picture to the other by a homography H, and then [v]x H fits for any v.
    So both are fitted, and depth must be seen: the points must misfit the best homography clearly worse than F.
    The homography is fitted together with the first terms of both lenses' distortion (k1, p1, p2), since a plane
    through a real lens misfits a homography by pixels, which is not depth.

    Args:
        points_left, points_right: (N, 2), N >= 8, as `check_points` returns them.
        F: (3, 3), what was fitted to them.

    Raises:
        InputError: the points lie on a line or in a plane, or the camera only turned.
    """
    from scipy.special import fdtri

    count = len(points_left)
    for side, points in (("left", points_left), ("right", points_right)):
        length, width = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if width <= THIN * length:
            raise InputError(
                f"the {count} points lie on a line in the {side} picture, from which no F follows:"
                " add points all over the picture"
            )
    residuals, parameters = _fit_plane(points_left, points_right)
    free_plane, free_epipolar = 2 * count - parameters, max(1, count - 7)
    plane = np.sqrt((residuals**2).sum() / free_plane)
    epipolar = np.sqrt((sampson_distances(F, points_left, points_right) ** 2).sum() / free_epipolar)
    extent = float(np.sqrt(np.mean([points.var(axis=0).sum() for points in (points_left, points_right)])))
    # The quantile of Fisher's distribution; scipy.stats has it too, and takes half a second to import.
    needed = max(LEAST_DEPTH, float(np.sqrt(fdtri(free_plane, free_epipolar, SIGNIFICANT))))
    if plane <= ANY_PLANE * extent and plane <= needed * max(epipolar, ROUNDING * extent):
        raise InputError(
            f"the {count} points lie in a plane, or the camera only turned (a homography fits to {plane:.2g} px),"
            " from which no F follows: add points at other depths"
        )


def _fit_plane(points_left: Doubles, points_right: Doubles) -> tuple[Doubles, int]:
    """Residuals (N, 2) of the best homography, with the lenses' distortion if there are enough points.

    They are Sampson's: how far both points of a match must move, to first order, to fit. Also the number of
    parameters.
    """
    to_left, to_right = normaliser(points_left), normaliser(points_right)
    left = (homogeneous(points_left) @ to_left.T)[:, :2]
    right = (homogeneous(points_right) @ to_right.T)[:, :2]
    first, _ = cv2.findHomography(left, right, 0)
    misfit = np.full((len(left), 2), np.inf)
    if first is None or abs(first[2, 2]) < ROUNDING:
        return misfit, 8
    with_lens = len(left) >= LENS_POINTS
    parameters = np.concatenate([(first / first[2, 2]).reshape(-1)[:8], np.zeros(6 if with_lens else 0)])
    for step in range(STEPS):
        residuals, slopes = _linearise(parameters, left, right)
        if not (np.isfinite(residuals).all() and np.isfinite(slopes).all()):
            return misfit, len(parameters)
        if step < STEPS - 1:
            parameters = parameters + np.linalg.lstsq(slopes, residuals, rcond=None)[0]
    return residuals.reshape(-1, 2) / to_right[0, 0], len(parameters)


def _linearise(parameters: Doubles, left: Doubles, right: Doubles) -> tuple[Doubles, Doubles]:
    """Residuals (2 N,) and their slopes (2 N, parameters), both whitened by how noise of either point enters."""
    H = np.append(parameters[:8], 1.0).reshape(3, 3)
    with np.errstate(all="ignore"):  # a fit that runs away is seen by its values
        projected = homogeneous(left) @ H.T
        carried = projected[:, :2] / projected[:, 2:]
        ends = homogeneous(left) / projected[:, 2:]
        moves = (H[None, :2, :2] - carried[:, :, None] * H[None, 2:, :2]) / projected[:, 2:, None]  # d carried / d left
        slopes = np.zeros((len(left), 2, len(parameters)))
        slopes[:, 0, 0:3] = slopes[:, 1, 3:6] = ends
        slopes[:, :, 6:8] = -carried[:, :, None] * ends[:, None, :2]
        residuals = right - carried
        if len(parameters) > 8:
            # The distortion is small, so that it enters in proportion.
            slopes[:, :, 8:11] = moves @ _distortion(left)
            slopes[:, :, 11:14] = -_distortion(right)
            residuals = residuals - slopes[:, :, 8:] @ parameters[8:]
        # Noise of the left point arrives through `moves`, that of the right one as it is.
        spread = np.eye(2) + moves @ moves.transpose(0, 2, 1)
        if not np.isfinite(spread).all():
            return np.full(2 * len(left), np.inf), slopes.reshape(2 * len(left), -1)
        whitener = np.linalg.inv(np.linalg.cholesky(spread))
        return (whitener @ residuals[:, :, None]).reshape(-1), (whitener @ slopes).reshape(2 * len(left), -1)


def _distortion(points: Doubles) -> Doubles:
    """(N, 2, 3): how k1, p1 and p2 (Brown 1966) move each point; p1 and p2 also stand for the unknown centre."""
    x, y = points.T
    square = x * x + y * y
    return np.stack(
        [
            np.column_stack([x * square, y * square]),
            np.column_stack([2 * x * y, square + 2 * y * y]),
            np.column_stack([square + 2 * x * x, 2 * x * y]),
        ],
        axis=2,
    )
