import corner_pairs
import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stereo_gpu.calibration.bundle import Bundle, Corners, lens_matrix, linearise, project, refine
from stereo_gpu.calibration.uncertainty import (
    _vector_by_turn,
    depth_deviations,
    depth_slopes,
    find_deviations,
    focal_share,
    shared_covariance,
    working_places,
)

TRIALS = 150  # spreads then scatter by 6 %
NOISE_PX = 0.15


def flat(deviations):
    cameras = [
        [camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion]
        for camera in (deviations.left, deviations.right)
    ]
    return np.array([*cameras[0], *cameras[1], *deviations.om, *deviations.T])


@pytest.fixture(scope="module")
def trials():
    """The truth; and of many calibrations with new noise each, the parameters, the deviations and the bundle."""
    bundle = corner_pairs.truth(6, seed=3)
    found, told, bundles = [], [], []
    for seed in range(TRIALS):
        corners = corner_pairs.corners_of(bundle, seed, NOISE_PX)
        fitted = refine(bundle, corners, settled=1e-8)
        covariance = shared_covariance(linearise(fitted, corners), 2 * len(corners[0].seen))
        found.append([*fitted.lenses[0], *fitted.lenses[1], *cv2.Rodrigues(fitted.R)[0].reshape(3), *fitted.T])
        told.append(flat(find_deviations(fitted, covariance)))
        bundles.append((fitted, covariance))
    return bundle, np.array(found), np.array(told), bundles


def test_estimates_spread_as_their_deviations_say(trials):
    _, found, told, _ = trials
    np.testing.assert_allclose(found.std(axis=0, ddof=1) / np.median(told, axis=0), 1.0, atol=0.2)


def test_depths_spread_as_their_deviations_say(trials):
    bundle, _, _, bundles = trials
    places = working_places(bundle, corner_pairs.SIZES, [450.0, 600.0])
    still = Bundle(bundle.lenses, bundle.R, bundle.T, np.eye(3)[None], np.zeros((1, 3)))
    where = Corners(np.zeros(len(places), np.int32), places, np.zeros((len(places), 2)))
    pixels = [project(still, where, side)[0].reshape(-1, 1, 2) for side in (0, 1)]
    depths = []
    for fitted, _ in bundles:
        left, right = (
            cv2.undistortPoints(seen, lens_matrix(lens), lens[4:]).reshape(-1, 2).T
            for seen, lens in zip(pixels, fitted.lenses, strict=True)
        )
        point = cv2.triangulatePoints(np.eye(3, 4), np.column_stack([fitted.R, fitted.T]), left, right)
        depths.append(point[2] / point[3])
    told = depth_deviations(depth_slopes(bundle, places), bundles[0][1])
    ratio = np.std(depths, axis=0, ddof=1) / told
    # OpenCV triangulates linearly, which is a little worse than least squares in the pictures.
    assert 0.9 < np.median(ratio) < 1.25


@pytest.mark.parametrize("vector", [(0.3, -0.2, 0.5), (0.0, 0.0, 0.0), (1e-6, 0, 0), (0, 3.1, 0.2)])
def test_the_rotation_vector_follows_a_small_turn(vector):
    vector = np.array(vector, np.float64)
    rotation = Rotation.from_rotvec(vector)
    derivative = _vector_by_turn(vector)
    for axis in np.eye(3):
        ahead, behind = ((Rotation.from_rotvec(way * 1e-5 * axis) * rotation).as_rotvec() for way in (1, -1))
        np.testing.assert_allclose(derivative @ axis, (ahead - behind) / 2e-5, atol=1e-5)


def test_more_views_are_more_certain(trials):
    bundle, _, told, _ = trials
    twice = corner_pairs.truth(24, seed=3)
    corners = corner_pairs.corners_of(twice, 1, NOISE_PX)
    fitted = refine(twice, corners)
    covariance = shared_covariance(linearise(fitted, corners), 2 * len(corners[0].seen))
    assert (flat(find_deviations(fitted, covariance)) < np.median(told, axis=0)).all()
    assert len(bundle.rotations) == 6


@pytest.mark.parametrize(("tilt", "low", "high"), [(0.45, 0, 0.01), (0.0, 0.15, np.inf)])
def test_parallel_boards_do_not_determine_the_focal_length(tilt, low, high):
    bundle = corner_pairs.truth(10, seed=2, tilt=tilt)
    left, _ = corner_pairs.corners_of(bundle, 2)
    assert low <= focal_share(bundle.lenses[0], bundle.rotations, bundle.translations, left) <= high
