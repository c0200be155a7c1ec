"""The eight-point algorithm against OpenCV's, against the truth, and on points from which no F follows."""

import cv2
import numpy as np
import pytest
import two_views

import stereo_gpu as sg
from stereo_gpu.epipolar.eight_point import eight_point
from stereo_gpu.epipolar.fundamental import find_fundamental
from stereo_gpu.epipolar.points import sampson_distances, symmetric_distances
from stereo_gpu.epipolar.pose import estimate_pose, undistort
from stereo_gpu.errors import InputError, StageError

BOARD = sg.Board(columns=10, rows=7, square=30.0)
BOUND_PX = 0.3  # of the issue


def off(F, other):
    """Largest difference of two matrices that are known up to a factor."""
    one, two = F / np.linalg.norm(F), other / np.linalg.norm(other)
    return min(np.abs(one - two).max(), np.abs(one + two).max())


@pytest.fixture(scope="module")
def boards(board_calibration):
    """The calibration of the 13 real board pairs, with their corners."""
    assert len(board_calibration.views) == 13
    return board_calibration.rig, [[side.astype(float) for side in view.seen] for view in board_calibration.views]


@pytest.mark.parametrize(("count", "noise"), [(8, 0.0), (9, 0.0), (20, 0.2), (500, 0.0), (500, 0.5)])
def test_as_opencv_to_rounding(count, noise):
    left, right = two_views.see(two_views.rig(), two_views.room(count, seed=count), noise)
    F = eight_point(left, right)
    assert np.linalg.norm(F) == pytest.approx(1)
    assert F.flat[np.abs(F).argmax()] > 0
    assert abs(np.linalg.det(F / np.abs(F).max())) < 1e-12
    # OpenCV takes the eigenvectors of A'A, and loses half of the digits with eight points.
    opencv, _ = cv2.findFundamentalMat(left, right, cv2.FM_8POINT)
    assert off(F, opencv) < (1e-3 if count == 8 else 1e-5)


def test_exact_points_give_the_true_matrix():
    rig = two_views.rig()
    left, right = two_views.see(rig, two_views.room(60))
    F = eight_point(left, right)
    assert off(F, two_views.fundamental(rig)) < 1e-9
    assert np.abs(sampson_distances(F, left, right)).max() < 1e-8
    assert np.abs((np.c_[right, np.ones(60)] @ F * np.c_[left, np.ones(60)]).sum(axis=1)).max() < 1e-9
    assert eight_point(right, left) == pytest.approx(F.T, abs=1e-9)


def test_noise_enters_in_proportion():
    left, right = two_views.see(two_views.rig(), two_views.room(300), 0.3)
    F = eight_point(left, right)
    # Noise of 0.3 px in all four coordinates: Sampson's distance is their part across the lines.
    assert np.sqrt(np.mean(sampson_distances(F, left, right) ** 2)) == pytest.approx(0.3, rel=0.15)
    # The distance of one point from its line has the noise of two coordinates.
    assert np.sqrt(np.mean(symmetric_distances(F, left, right) ** 2)) == pytest.approx(0.3 * np.sqrt(2), rel=0.15)


def test_distances_of_known_matches():
    F = np.array([[0, 0, 0], [0, 0, -1.0], [0, 1, 0]])  # rows correspond
    left, right = np.array([[10.0, 20.0], [30.0, 40.0]]), np.array([[5.0, 20.0], [7.0, 43.0]])
    assert symmetric_distances(F, left, right) == pytest.approx([0, 3])
    assert np.abs(sampson_distances(F, left, right)) == pytest.approx([0, 3 / np.sqrt(2)])


@pytest.mark.parametrize(("count", "noise"), [(8, 0.0), (400, 0.0), (12, 0.3), (40, 0.3), (400, 0.3), (400, 1.5)])
def test_points_in_a_plane_are_refused(count, noise):
    left, right = two_views.see(two_views.rig(), two_views.wall(count), noise)
    with pytest.raises(InputError, match=rf"the {count} points lie in a plane.* add points at other depths"):
        eight_point(left, right)


@pytest.mark.parametrize("lens", [-0.3, 0.2])
def test_a_plane_through_bending_lenses_is_one_still(lens):
    rig = two_views.rig((lens, 0.05, 0.001, -0.001, 0.0))
    left, right = two_views.see(rig, two_views.wall(80), 0.1)
    with pytest.raises(InputError, match="lie in a plane"):
        eight_point(left, right)
    left, right = two_views.see(rig, two_views.room(80), 0.1)
    assert np.median(symmetric_distances(eight_point(left, right), left, right)) < 2


def test_a_turn_alone_is_refused():
    rig = sg.Rig(two_views.camera(), two_views.camera(), two_views.R, np.array([-1e-9, 0, 0]))
    with pytest.raises(InputError, match="or the camera only turned"):
        eight_point(*two_views.see(rig, two_views.room(60), 0.2))


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_points_on_a_line_are_refused(noise):
    along = np.linspace(-1, 1, 30)
    left, right = two_views.see(two_views.rig(), np.column_stack([along, 0.3 * along, 5 + along]), noise)
    with pytest.raises(InputError, match="the 30 points lie on a line in the left picture"):
        eight_point(left, right)


def test_depth_is_seen_where_there_is_some():
    """A table top with a box on it: a quarter of the points stand out."""
    points = np.vstack([two_views.wall(90), two_views.room(30, near=4, far=4.4)])
    left, right = two_views.see(two_views.rig(), points, 0.3)
    assert np.median(symmetric_distances(eight_point(left, right), left, right)) < 0.5


def test_wrong_matches_are_not_taken_for_a_plane():
    left, right = two_views.see(two_views.rig(), two_views.room(100), 0.3)
    right[:15] = np.random.default_rng(0).uniform(0, 480, (15, 2))
    assert np.linalg.norm(eight_point(left, right)) == pytest.approx(1)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda p, q: (p[:7], q[:7]), "7 matched points, 8 are needed"),
        (lambda p, q: (p[:0], q[:0]), "0 matched points, 8 are needed"),
        (lambda p, q: (p[:9], q[:10]), "9 points on the left, 10 on the right"),
        (lambda p, q: (np.repeat(p[:5], 4, axis=0), np.repeat(q[:5], 4, axis=0)), "5 of 20 matches differ"),
        (lambda p, q: (np.where(p == p[3, 0], np.nan, p), q), r"points_left\[3\] is \[nan"),
        (lambda p, q: (p, np.where(q == q[2, 1], np.inf, q)), r"points_right\[2\] is .*inf"),
        (lambda p, q: (p.T, q.T), r"points_left has shape \(2, 30\)"),
        (lambda p, q: (p[:, :, None], q), r"points_left has shape \(30, 2, 1\)"),
        (lambda p, q: (p, "points"), "points_right has shape"),
        (lambda p, q: ([[1, 2], [3]], q), "points_left is"),
        (lambda p, q: (None, q), "points_left has shape"),
        (lambda p, q: (p * 1e200, q), "points_left reaches .*, the limit is 1e.08: give places in px"),
        (lambda p, q: (p, q * 1e-300), "points_right holds 30 points at one place"),
        (lambda p, q: (np.full_like(p, 3.0), q), "points_left holds 30 points at one place"),
    ],
)
def test_no_such_points(change, told):
    points = two_views.see(two_views.rig(), two_views.room(30))
    with pytest.raises(InputError, match=told) as refused:
        eight_point(*change(*points))
    assert "\n" not in str(refused.value)


def test_corners_of_13_board_pairs(boards):
    rig, views = boards
    left, right = (np.concatenate(side) for side in zip(*views, strict=True))
    raw = np.median(symmetric_distances(eight_point(left, right), left, right))
    assert raw <= BOUND_PX
    # Without the lenses' distortion one F fits all of the picture, and holds rotation and translation.
    flat = [undistort(points, camera) * 500 for points, camera in ((left, rig.left), (right, rig.right))]
    F = eight_point(*flat)
    assert np.median(symmetric_distances(F, *flat)) <= BOUND_PX / 2
    scale = np.diag([500.0, 500, 1])
    first, second, shift = cv2.decomposeEssentialMat(scale @ F @ scale)
    rotation = min((first, second), key=lambda R: two_views.angle(R, rig.R))
    assert two_views.angle(rotation, rig.R) <= 0.3
    assert min(two_views.angle(sign * shift.ravel(), rig.T) for sign in (1, -1)) <= 1
    pose = estimate_pose(left, right, rig.left, rig.right)
    assert two_views.angle(pose.R, rig.R) <= 0.3
    assert two_views.angle(pose.t, rig.T) <= 1
    assert pose.inliers.mean() > 0.95


def test_corners_of_one_board_pair_alone_are_refused(boards):
    rig, views = boards
    for left, right in views:
        for points in ((left, right), (undistort(left, rig.left), undistort(right, rig.right))):
            with pytest.raises(InputError, match="the 54 points lie in a plane"):
                eight_point(*points)
    for one, other in zip(views[1:], views, strict=False):  # two boards are enough
        assert np.linalg.norm(eight_point(*(np.concatenate(side) for side in zip(one, other, strict=True)))) > 0.99


def test_corners_of_another_rig_s_boards(data):
    folder = data / "rigs" / "cup" / "calibration_images"
    views = list(two_views.board_corners(folder, sg.Board(12, 9, 12.0), every=4))
    assert len(views) >= 7
    for left, right in views:
        with pytest.raises(InputError, match="the 88 points lie in a plane"):
            eight_point(left, right)
    left, right = (np.concatenate(side) for side in zip(*views, strict=True))
    assert np.median(symmetric_distances(eight_point(left, right), left, right)) <= BOUND_PX


def test_robust_with_wrong_matches():
    rig = two_views.rig()
    left, right = two_views.see(rig, two_views.room(200), 0.3)
    wrong = np.arange(200) % 10 < 3
    right[wrong] = np.random.default_rng(0).uniform(0, 480, (wrong.sum(), 2))
    F, inliers, noise_px = find_fundamental(left, right)
    clean_left, clean_right = two_views.see(rig, two_views.room(200, seed=7))
    assert np.median(symmetric_distances(F, clean_left, clean_right)) < 0.2
    assert inliers[~wrong].mean() > 0.95
    assert inliers[wrong].mean() < 0.1
    assert 0.2 < noise_px < 0.5
    assert np.linalg.svd(F)[1][2] < 1e-12


def test_robust_with_exact_and_with_hopeless_points():
    left, right = two_views.see(two_views.rig(), two_views.room(50))
    assert find_fundamental(left, right).inliers.all()
    with pytest.raises(InputError, match="lie in a plane"):
        find_fundamental(*two_views.see(two_views.rig(), two_views.wall(80), 0.3))
    same = np.full((30, 2), 5.0)
    with pytest.raises(InputError, match="points_left holds 30 points at one place"):
        find_fundamental(same, same)
    random = np.random.default_rng(3).uniform(0, 480, (2, 12, 2))
    with pytest.raises((StageError, InputError), match=r"geometry fits|plane"):
        find_fundamental(*random)
