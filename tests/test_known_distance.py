"""The scale of a reconstruction from one known distance."""

import math

import cv2
import numpy as np
import pytest

from stereo_gpu.errors import InputError
from stereo_gpu.known_distance import KnownDistance, scale_of
from stereo_gpu.rig import Camera

MATRIX = np.array([[300.0, 0, 79.5], [0, 300, 59.5], [0, 0, 1]])
CAMERA = Camera(MATRIX, np.array([-0.2, 0.05, 0, 0, 0]), (160, 120))


def plane_points(rotation, depth=10.0):
    """Points of a plane straight before the rectified camera, with a hole."""
    y, x = np.mgrid[:120, :160]
    points = np.stack([(x - 79.5) / 300 * depth, (y - 59.5) / 300 * depth, np.full(x.shape, depth)], -1)
    points[:40, :40] = np.nan
    return points.astype(np.float32)


def test_a_known_length_gives_the_scale_through_lens_and_rotation():
    rotation = cv2.Rodrigues(np.array([0.02, -0.03, 0.01]))[0]
    points = plane_points(rotation)
    ends = [(60, 50), (110, 90)]
    apart = float(np.linalg.norm(points[50, 60] - points[90, 110]))
    # Where the raw camera sees those two points.
    raw, _ = cv2.projectPoints(
        np.array([points[y, x] @ rotation for x, y in ends]), np.zeros(3), np.zeros(3), MATRIX, CAMERA.distortion
    )
    known = KnownDistance(tuple(raw[0, 0]), tuple(raw[1, 0]), length=125.0)
    assert scale_of(known, points, CAMERA, rotation, MATRIX) == pytest.approx(125.0 / apart, rel=1e-3)


@pytest.mark.parametrize(
    ("ends", "words"),
    [
        (((20, 20), (100, 100)), r"no depth is known at \(20, 20\)"),
        (((100, 100), (400, 20)), r"\(400, 20\), outside of the pictures of 160 x 120 px"),
        (((100, 100), (5000, 20)), r"\(5000, 20\), outside"),  # where this lens model folds back into the picture
        (((1e300, 100), (50, 20)), "outside of the pictures"),
        (((100, 100), (100.2, 100)), "are one point"),
    ],
)
def test_places_that_tell_nothing_are_refused(ends, words):
    with pytest.raises(InputError, match=words):
        scale_of(KnownDistance(*ends, length=10), plane_points(None), CAMERA, np.eye(3), MATRIX)


@pytest.mark.parametrize("length", [0, -3, math.nan, math.inf])
def test_a_length_that_is_none_is_refused(length):
    with pytest.raises(InputError):
        KnownDistance((1, 2), (3, 4), length)
