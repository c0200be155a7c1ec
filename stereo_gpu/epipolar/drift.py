"""How far a rig's right camera has turned and moved since the calibration, from the rows of matched points."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import cv2
import numpy as np

from stereo_gpu.epipolar.least_squares import fit_softly
from stereo_gpu.epipolar.robust import MAD_TO_SIGMA
from stereo_gpu.epipolar.rows import find_rows
from stereo_gpu.rig import Rig
from stereo_gpu.types import Doubles

# What a knock does to cameras on one bar, standard deviations in degrees. What the rows say nothing of stays within.
TURN_DEG, MOVE_DEG = 0.5, 0.5
NOISE_PX = 0.3  # of a match's row, before its own spread is known
LEAST_NOISE_PX = 0.05
PITCH, YAW, ROLL, DOWN, FORWARD = ALL = (0, 1, 2, 3, 4)


@dataclass(frozen=True, kw_only=True, eq=False)
class Drift:
    """A small motion of the right camera, the distance between the cameras kept.

    Args:
        turn: (3,) degrees, rotation vector in the right camera's frame: about x (pitch), y (yaw) and z (roll).
        move: (2,) degrees by which the right camera's place, seen from the left one, went down and forward.
        deviations: (5,) degrees, of turn and move; 0 for what was not sought.
    """

    turn: Doubles
    move: Doubles
    deviations: Doubles

    @property
    def turn_deg(self) -> float:
        """Angle of the rotation."""
        return float(np.linalg.norm(self.turn))

    @property
    def move_deg(self) -> float:
        """Angle between the two directions from the left camera to the right one."""
        return float(np.degrees(np.arctan(np.linalg.norm(np.tan(np.radians(self.move))))))


def drifted(rig: Rig, drift: Drift) -> Rig:
    """The rig with its right camera turned and moved."""
    rotation, translation = _moved(rig, np.concatenate([drift.turn, drift.move]))
    return dataclasses.replace(rig, R=rotation, T=translation)


def fit_drift(
    rays_left: Doubles,
    rays_right: Doubles,
    rig: Rig,
    focal: float,
    *,
    weights: Doubles | None = None,
    free: tuple[int, ...] = ALL,
) -> tuple[Drift, Doubles]:
    """The drift that brings matched rays onto common rows, and the vertical errors (N,) px that it leaves.

    Up to five numbers are sought, all that rows can tell of two cameras, by robust least squares with a ridge.

    Args:
        rays_left, rays_right: (N, 2) each, N at least 5, finite.
        rig: as it was calibrated.
        focal: px, the scale of the errors.
        weights: (N,) of each match's error; None for 1.
        free: which of pitch, yaw, roll, down and forward may differ from 0, by number.
    """
    weights = np.ones(len(rays_left)) if weights is None else weights
    chosen = list(free)
    prior = np.array([TURN_DEG] * 3 + [MOVE_DEG] * 2)

    def errors(numbers: Doubles) -> Doubles:
        every = np.zeros(5)
        every[chosen] = numbers
        return find_rows(rays_left, rays_right, *_moved(rig, every), focal).vertical

    noise, found = NOISE_PX, np.zeros(len(chosen))
    for _ in range(2):

        def residuals(numbers: Doubles, noise: float = noise) -> Doubles:
            return np.concatenate([weights * errors(numbers) / noise, numbers / prior[chosen]])

        fit = fit_softly(residuals, found, prior[chosen])
        found = fit.numbers
        left = errors(found)
        noise = max(LEAST_NOISE_PX, MAD_TO_SIGMA * float(np.median(np.abs(left))))
    every, deviations = np.zeros(5), np.zeros(5)
    every[chosen] = found
    deviations[chosen] = np.linalg.norm(np.linalg.pinv(fit.slopes), axis=1)
    return Drift(turn=every[:3], move=every[3:], deviations=deviations), left


def _moved(rig: Rig, numbers: Doubles) -> tuple[Doubles, Doubles]:
    """R and T after the right camera turned by numbers[:3] and moved by numbers[3:], all in degrees."""
    turn = cv2.Rodrigues(np.radians(numbers[:3]))[0]
    place = -rig.R.T @ rig.T  # of the right camera in the left one's frame
    along = place / rig.baseline
    down = np.array([0.0, 1.0, 0.0]) - along[1] * along
    down /= np.linalg.norm(down)
    forward = np.cross(along, down)
    moved = along + np.tan(np.radians(numbers[3])) * down + np.tan(np.radians(numbers[4])) * forward
    rotation = turn @ rig.R
    translation: Doubles = -rotation @ (moved * (rig.baseline / np.linalg.norm(moved)))
    return rotation, translation
