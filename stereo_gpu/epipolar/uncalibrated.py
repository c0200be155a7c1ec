"""A rig for two pictures of unknown cameras, from matched features alone: up to scale, the focal length guessed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from stereo_gpu.epipolar.faults import BEHIND
from stereo_gpu.epipolar.points import check_points
from stereo_gpu.epipolar.pose import (
    LEAST_PARALLAX,
    first_poses,
    inverse_depths,
    misfit_of_turn,
    pose_distances,
    refine_pose,
    undistort,
)
from stereo_gpu.epipolar.robust import WITHIN, Fit, best_of, fit_robustly, misfit
from stereo_gpu.epipolar.rows import find_rows, focal_length
from stereo_gpu.epipolar.sharpen import match_sharply
from stereo_gpu.errors import InputError, StageError
from stereo_gpu.images import check_pair
from stereo_gpu.rig import Camera, Rig
from stereo_gpu.types import UNSCALED, Doubles, Picture

GUESSED_FOCAL = 1.0  # of the longer side: 53 degrees across; webcams and phones have 0.6 to 1, Middlebury's 1.3
FEWEST = 30  # matches: of a board alone a few fit by chance, and then even left and right are open
LIKELY_TURN = 0.2  # rad: standard deviation of each angle between two cameras side by side
LIKELY_LEAN = 0.15  # of the baseline: how far one stands above or before the other
LIKELY_BEND = 0.15  # k1 of a lens, where one unit is the focal length
LENS_GAIN = 4.0  # matches that a lens that bends must fit besides, or both are taken for straight
START_PX = 1.0
COARSEST = 0.004  # of the longer side: noise above it is no epipolar geometry
LEAN_GAIN = 0.1  # of the matches: that cameras above or before each other must fit besides, to be believed
MOST_FITTED = 1000  # matches


@dataclass(frozen=True, kw_only=True)
class SelfCalibration:
    """A rig that was made from one pair of pictures.

    Args:
        rig: both cameras of one focal length and lens, principal points in the middle; T of length 1, in baselines.
        points_left, points_right: (N, 2) px, the matches that fit.
        found_left, found_right: (M, 2) px, all matches that there were.
        vertical_px: median distance between the rows of those that fit, once rectified.
        focal_known: whether the focal length was given; where it is guessed, depth is stretched as much as it is wrong.
    """

    rig: Rig
    points_left: Doubles
    points_right: Doubles
    found_left: Doubles
    found_right: Doubles
    vertical_px: float
    focal_known: bool

    @property
    def matches(self) -> int:
        """How many matches there were in all."""
        return len(self.found_left)

    @property
    def focal_px(self) -> float:
        """Focal length of both cameras."""
        return float(self.rig.left.matrix[0, 0])


def rig_from_pair(left: Picture, right: Picture, *, focal_px: float | None = None) -> SelfCalibration:
    """Make a rig for two pictures by cameras of one kind that stand side by side.

    Features are matched; see `rig_from_points` for the rest.

    Args:
        left, right: raw pictures of one size.
        focal_px: focal length, px, if known; else one as long as the pictures' longer side is taken.

    Raises:
        PictureError: they are no such pictures.
        InputError: they are swapped, or the cameras stand above or behind each other.
        StageError: the pictures do not show enough in common, or were taken from one place.
    """
    check_pair(left, right)
    points = match_sharply(left, right)
    if len(points[0]) < FEWEST:
        raise StageError(
            f"{len(points[0])} features match, {FEWEST} are needed: give two pictures of one scene with texture,"
            " or calibrate with a board and give the rig"
        )
    return rig_from_points(*points, (left.shape[1], left.shape[0]), focal_px=focal_px)


def rig_from_points(
    points_left: Doubles, points_right: Doubles, size: tuple[int, int], *, focal_px: float | None = None
) -> SelfCalibration:
    """Make a rig for matched points of two pictures.

    As the quasi-Euclidean rectification of Fusiello and Irsara (2008, 2011): the cameras are taken for real ones, of
    equal focal length, with square pixels and the principal point in the middle, so that the pictures are only turned
    and keep their shape; Sampson distances decide on the five angles. Ours differs in two ways. Wrong matches are
    told by the noise of the others (Cauchy's loss), and cameras side by side are expected, which decides where a
    repeated pattern or a plane leaves more than one answer. And a lens that bends lines (k1) is fitted where more
    matches fit then. The focal length is not: the pairs tried left it open by 30 %.

    Args:
        points_left, points_right: (N, 2) px; some may be wrong.
        size: width and height of both pictures.
        focal_px: focal length, px; None for the longer side.

    Raises:
        InputError: the points or the focal length are no such things, the pictures are swapped, or the cameras stand
            above or behind each other.
        StageError: no rig fits, or the pictures were taken from one place.
    """
    left, right = check_points(points_left, points_right, FEWEST)
    longer = max(size)
    if focal_px is not None and not 0.1 * longer <= focal_px <= 100 * longer:
        raise InputError(f"the focal length is {focal_px:g} px for pictures {longer} px long: give it in px, not mm")
    focal = float(GUESSED_FOCAL * longer if focal_px is None else focal_px)
    # Evenly among those that are there: more make the fit slower, and hardly better.
    some = slice(None, None, -(-len(left) // MOST_FITTED))
    rig, fit = _likeliest(left[some], right[some], size, focal)
    rays_left, rays_right = undistort(left, rig.left), undistort(right, rig.right)
    disparities = focal * inverse_depths(rig.R, rig.T, rays_left, rays_right)
    fits = np.abs(pose_distances(rig.R, rig.T, rays_left, rays_right, focal)) <= WITHIN * fit.noise
    if fit.noise > COARSEST * longer or int(fits.sum()) < FEWEST:
        raise StageError(
            f"the best epipolar geometry fits {int(fits.sum())} of {len(left)} matches to {fit.noise:.2g} px, which is"
            " not enough: give two pictures of one scene, or calibrate with a board and give the rig"
        )
    turn_px = focal * misfit_of_turn(rays_left[fits], rays_right[fits])
    if turn_px <= LEAST_PARALLAX * fit.noise:
        raise StageError(
            f"both pictures were taken from one place: a turn of the camera alone fits {int(fits.sum())} matches to"
            f" {turn_px:.2g} px; move the camera aside between them"
        )
    behind = float((disparities[fits] < -WITHIN * fit.noise).mean())
    if behind > BEHIND:
        raise InputError(
            f"the pictures look swapped: {behind:.0%} of {int(fits.sum())} matched points would lie behind the"
            " cameras; give the left camera's picture first"
        )
    fits &= disparities > -WITHIN * fit.noise
    return SelfCalibration(
        rig=rig,
        points_left=left[fits],
        points_right=right[fits],
        found_left=left,
        found_right=right,
        vertical_px=float(np.median(np.abs(vertical_errors(rig, left[fits], right[fits])))),
        focal_known=focal_px is not None,
    )


def vertical_errors(rig: Rig, points_left: Doubles, points_right: Doubles) -> Doubles:
    """(N,) row in the left picture less row in the right one, once rectified with `rig`, px."""
    sides = undistort(points_left, rig.left), undistort(points_right, rig.right)
    return find_rows(*sides, rig.R, rig.T, focal_length(rig)).vertical


def _likeliest(left: Doubles, right: Doubles, size: tuple[int, int], focal: float) -> tuple[Rig, Fit]:
    """The rig of cameras side by side that fits most matches; its lens straight unless a bent one fits more.

    Raises:
        InputError: cameras that stand otherwise fit far more.
    """
    straight = _rig(np.zeros(5), size, focal)
    rays = undistort(left, straight.left), undistort(right, straight.right)
    poses = first_poses(*rays, focal)
    (_, t), free = best_of([refine_pose(*pose, *rays, focal) for pose in poses])
    fits = [_fit(left, right, size, focal, poses, bent=bent) for bent in (False, True)]
    noise = min(free.noise, *(fit.noise for _, fit in fits))
    costs = [misfit(fit, noise) for _, fit in fits]
    best = int(costs[1] < costs[0] - LENS_GAIN)
    across = int(np.abs(t[1:]).argmax()) + 1
    if abs(t[0]) < abs(t[across]) and misfit(free, noise) < costs[best] - LEAN_GAIN * len(left):
        stands, way = "in front of or behind", ""
        if across == 1:
            stands, way = "above or below", ", or turn both upright: EXIF's orientation is ignored"
        raise InputError(
            f"one camera stands {stands} the other rather than beside it (T points along {np.round(t, 2).tolist()}):"
            f" move it straight aside between the pictures{way}"
        )
    return fits[best]


def _fit(
    left: Doubles,
    right: Doubles,
    size: tuple[int, int],
    focal: float,
    poses: Sequence[tuple[Doubles, Doubles]],
    *,
    bent: bool,
) -> tuple[Rig, Fit]:
    """The likeliest rig near one of these poses; with a lens that bends lines, or without."""
    deviations = np.array([LIKELY_TURN] * 3 + [LIKELY_LEAN] * 2 + [LIKELY_BEND] * bent)

    def compose(parameters: Doubles) -> Rig:
        return _rig(parameters, size, focal)

    def residuals(parameters: Doubles) -> Doubles:
        rig = compose(parameters)
        rays = undistort(left, rig.left), undistort(right, rig.right)
        return pose_distances(rig.R, rig.T, *rays, focal)

    fits = []
    for R, t in poses:
        # Of t and -t, which fit alike, the one that has the left camera on the left.
        if abs(t[0]) < max(abs(t[1]), abs(t[2])):
            continue
        turn = cv2.Rodrigues(R)[0].ravel()
        start = np.array([*turn, -t[1] / t[0], -t[2] / t[0]] + [0.0] * bent)
        fit = fit_robustly(residuals, start, START_PX, (np.zeros(len(start)), deviations))
        fits.append((compose(fit.parameters), fit))
    return best_of(fits)


def _rig(parameters: Doubles, size: tuple[int, int], focal: float) -> Rig:
    """Two equal cameras: three numbers turn the right one, two set the direction of T, a sixth one bends lines."""
    middle = (size[0] - 1) / 2, (size[1] - 1) / 2
    matrix = np.array([[focal, 0, middle[0]], [0, focal, middle[1]], [0, 0, 1]])
    lens = np.zeros(5)
    lens[0] = parameters[5] if len(parameters) > 5 else 0.0
    camera = Camera(matrix, lens, size)
    T = np.array([-1.0, *parameters[3:5]])
    return Rig(camera, camera, cv2.Rodrigues(parameters[:3])[0], T / np.linalg.norm(T), unit=UNSCALED)
