import corner_pairs
import cv2
import numpy as np
import pytest

from stereo_gpu.calibration.bundle import (
    Bundle,
    Corners,
    jacobian,
    lens_matrix,
    linearise,
    refine,
    residuals,
    scaled_inverse,
)
from stereo_gpu.errors import CalibrationError


@pytest.fixture(scope="module")
def taken():
    """The truth, and corners with noise."""
    bundle = corner_pairs.truth(7, seed=5)
    return bundle, corner_pairs.corners_of(bundle, seed=5)


def moved(bundle, shared=None, pose=None):
    """A bundle whose shared numbers and poses changed a little, in the meaning that the derivatives have."""
    shared = np.zeros(bundle.shared) if shared is None else shared
    pose = np.zeros(6) if pose is None else pose
    first, second = len(bundle.lenses[0]), len(bundle.lenses[0]) + len(bundle.lenses[1])
    return Bundle(
        (bundle.lenses[0] + shared[:first], bundle.lenses[1] + shared[first:second]),
        cv2.Rodrigues(shared[-6:-3])[0] @ bundle.R,
        bundle.T + shared[-3:],
        cv2.Rodrigues(pose[:3])[0] @ bundle.rotations,
        bundle.translations + pose[3:],
    )


@pytest.mark.parametrize("side", [0, 1])
def test_derivatives_are_those_of_finite_differences(taken, side):
    bundle, corners = taken
    _, by_shared, by_pose = jacobian(bundle, corners[side], side)
    for number in range(bundle.shared):
        step = np.zeros(bundle.shared)
        step[number] = 1e-5
        ahead, behind = (residuals(moved(bundle, shared=way * step), corners)[side] for way in (1, -1))
        np.testing.assert_allclose(by_shared[:, :, number], (ahead - behind) / 2e-5, rtol=1e-4, atol=1e-4)
    for number in range(6):
        step = np.zeros(6)
        step[number] = 1e-5
        ahead, behind = (residuals(moved(bundle, pose=way * step), corners)[side] for way in (1, -1))
        np.testing.assert_allclose(by_pose[:, :, number], (ahead - behind) / 2e-5, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("coefficients", [5, 8])
def test_it_finds_the_minimum_that_opencv_finds(taken, coefficients):
    truth, corners = taken
    lenses = tuple(np.concatenate([lens, np.zeros(coefficients - 5)]) for lens in truth.lenses)
    start = Bundle(lenses, corner_pairs.turned(0.5), truth.T + 2, truth.rotations, truth.translations)
    found = refine(start, corners)
    points = [corner_pairs.BOARD.points] * len(truth.rotations)
    seen = [[ours.seen[ours.view == view].astype(np.float32) for view in range(len(points))] for ours in corners]
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | (cv2.CALIB_RATIONAL_MODEL if coefficients == 8 else 0)
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 500, 1e-12)
    given = [part for lens in lenses for part in (lens_matrix(lens), lens[4:].copy())]
    rms, left, _, right, _, rotation, translation, *_ = cv2.stereoCalibrate(
        points, *seen, *given, corner_pairs.SIZES[0], flags=flags, criteria=stop
    )
    ours = np.sqrt(linearise(found, corners).squares / (2 * len(corners[0].seen)))
    assert ours <= rms * (1 + 1e-5)  # OpenCV takes corners in single precision
    if coefficients == 5:  # with 8 the valley is so flat that either may stop anywhere in it
        np.testing.assert_allclose(found.T, translation.reshape(3), atol=1e-3)
        np.testing.assert_allclose(found.R, rotation, atol=1e-6)
        np.testing.assert_allclose(lens_matrix(found.lenses[0]), left, atol=1e-2)
        np.testing.assert_allclose(lens_matrix(found.lenses[1]), right, atol=1e-2)


def test_corners_that_one_camera_alone_sees_count(taken):
    truth, corners = taken
    half = corners[1]
    kept = half.points[:, 0] < 100
    part = corners[0], Corners(half.view[kept], half.points[kept], half.seen[kept])
    found = refine(truth, part)
    np.testing.assert_allclose(found.T, truth.T, atol=1.0)
    whole, less = (linearise(truth, some).reduced()[0].sum(axis=0) for some in (corners, part))
    assert (np.linalg.eigvalsh(whole - less) > -1e-6 * np.linalg.norm(whole)).all()  # fewer corners know less


def test_poses_alone_leave_the_cameras_as_they_are(taken):
    truth, corners = taken
    off = moved(truth, pose=np.array([0.02, -0.03, 0.01, 5, -4, 10]))
    found = refine(off, corners, poses_only=True)
    np.testing.assert_array_equal(found.T, truth.T)
    np.testing.assert_array_equal(found.lenses[0], truth.lenses[0])
    np.testing.assert_allclose(found.translations, truth.translations, atol=1.5)


def test_part_of_the_views(taken):
    truth, corners = taken
    part = corners[0].only([1, 4])
    assert np.unique(part.view).tolist() == [0, 1]
    np.testing.assert_array_equal(part.seen[part.view == 1], corners[0].seen[corners[0].view == 4])
    assert len(truth.only([1, 4]).rotations) == 2


def test_what_is_not_determined_leaves_the_rest_as_it_is():
    known = np.array([[4.0, 1.0], [1.0, 9.0]])
    matrix = np.zeros((4, 4))
    matrix[:2, :2] = known
    matrix[2:, 2:] = 1e6  # two numbers of which only the sum is known
    inverse = scaled_inverse(matrix)
    np.testing.assert_allclose(inverse[:2, :2], np.linalg.inv(known), rtol=1e-9)
    assert inverse[2, 2] > 1e6
    with pytest.raises(CalibrationError, match="do not determine"):
        scaled_inverse(np.diag([1.0, 0.0]))
