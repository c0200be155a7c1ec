"""Rotation and direction of translation, from points with known truth and from real features."""

import cv2
import numpy as np
import pytest
import two_views

import stereo_gpu as sg
from stereo_gpu.epipolar.pose import estimate_pose
from stereo_gpu.errors import InputError, StageError

LENS = (-0.28, 0.09, 0.001, -0.0005, 0.0)


def estimate(rig, left, right):
    pose = estimate_pose(left, right, rig.left, rig.right)
    R, t, inliers = pose
    assert np.linalg.norm(t) == pytest.approx(1)
    assert np.abs(R @ R.T - np.eye(3)).max() < 1e-12 and np.linalg.det(R) > 0
    assert inliers.shape == (len(left),) and inliers.dtype == bool
    return pose


def test_exact_points_through_bending_lenses():
    rig = two_views.rig(LENS)
    pose = estimate(rig, *two_views.see(rig, two_views.room(40)))
    assert two_views.angle(pose.R, rig.R) < 1e-4
    assert two_views.angle(pose.t, rig.T) < 1e-3
    assert pose.inliers.all()


@pytest.mark.parametrize("seed", range(4))
def test_noise_and_wrong_matches(seed):
    rig = two_views.rig(LENS)
    left, right = two_views.see(rig, two_views.room(200, seed), 0.3, seed)
    wrong = np.arange(200) % 10 < 3
    right[wrong] = np.random.default_rng(seed).uniform(0, 480, (wrong.sum(), 2))
    pose = estimate(rig, left, right)
    assert two_views.angle(pose.R, rig.R) < 0.3
    assert two_views.angle(pose.t, rig.T) < 1.5
    assert pose.inliers[~wrong].mean() > 0.95
    assert pose.inliers[wrong].mean() < 0.1


@pytest.mark.parametrize("turn", [0.3, 1.5])
def test_cameras_far_from_side_by_side(turn):
    """The right camera looks at the same middle from around the corner, or is turned about its axis."""
    for axis in (np.array([0, 1.0, 0]), np.array([0, 0, 1.0])):
        R = cv2.Rodrigues(turn * axis)[0]
        middle = np.array([0, 0, 5.0])
        rig = sg.Rig(two_views.camera(), two_views.camera(), R, middle - R @ middle + [0.3, 0.2, 0.1])
        left, right = two_views.see(rig, two_views.room(120), 0.2)
        pose = estimate(rig, left, right)
        assert two_views.angle(pose.R, R) < 0.2
        assert two_views.angle(pose.t, rig.T) < 1


def test_a_plane_has_a_pose():
    """A plane seen alone fits a second pose too, which puts a part of it behind a camera."""
    rig = two_views.rig()
    pose = estimate(rig, *two_views.see(rig, two_views.wall(120), 0.1))
    assert two_views.angle(pose.R, rig.R) < 0.5
    assert two_views.angle(pose.t, rig.T) < 3


def test_the_order_of_the_pictures_turns_the_pose_round():
    rig = two_views.rig()
    left, right = two_views.see(rig, two_views.room(100), 0.1)
    there, back = estimate_pose(left, right, rig.left, rig.right), estimate_pose(right, left, rig.right, rig.left)
    assert two_views.angle(there.R, back.R.T) < 0.01
    assert two_views.angle(there.t, -back.R.T @ back.t) < 0.1


def test_a_turn_alone_has_no_direction():
    still = sg.Rig(two_views.camera(), two_views.camera(), two_views.R, np.array([-1e-7, 0, 0]))
    left, right = two_views.see(still, two_views.room(100), 0.2)
    for points in ((left, right), (left, left), (left + 0.0, left + 1e-12)):
        with pytest.raises(StageError, match="the cameras only turned"):
            estimate_pose(*points, still.left, still.right)


def test_refused():
    rig = two_views.rig()
    left, right = two_views.see(rig, two_views.room(30))
    with pytest.raises(InputError, match="7 matched points, 8 are needed"):
        estimate_pose(left[:7], right[:7], rig.left, rig.right)
    with pytest.raises(InputError, match=r"points_left\[0\] is \[nan"):
        estimate_pose(left * np.nan, right, rig.left, rig.right)
    with pytest.raises(InputError, match="camera_right is a NoneType: give a Camera"):
        estimate_pose(left, right, rig.left, None)
    random = np.random.default_rng(2).uniform(0, 480, (2, 10, 2))
    with pytest.raises(StageError, match=r"pose fits \d+ of 10 matches|no pose fits 8 of 10"):
        estimate_pose(*random, rig.left, rig.right)


@pytest.fixture(scope="module")
def cup(data):
    """The raw pair of the cup, with the rig that the pictures' owner published."""
    folder = data / "rigs" / "cup"
    file = cv2.FileStorage(str(folder / "published_opencv.yml"), cv2.FILE_STORAGE_READ)
    values = {name: file.getNode(name).mat() for name in ("K1", "D1", "K2", "D2", "R", "T")}
    cameras = [sg.Camera(values[f"K{i}"], values[f"D{i}"].ravel(), (640, 480)) for i in (1, 2)]
    pictures = [sg.read_image(folder / "test_images" / f"{side}Pic.jpg") for side in ("left", "right")]
    return pictures, sg.Rig(*cameras, values["R"], values["T"].ravel())


def test_features_of_the_cup(cup):
    pictures, rig = cup
    left, right = sg.match_features(*pictures)
    pose = sg.estimate_pose(left, right, rig.left, rig.right)
    assert two_views.angle(pose.R, rig.R) <= 1  # the bounds; OpenCV's MAGSAC alone: 1.4 and 6.3
    assert two_views.angle(pose.t, rig.T) <= 4
    assert pose.inliers.mean() > 0.7


def test_some_features_of_the_cup_do_nearly_as_well(cup):
    pictures, rig = cup
    left, right = sg.match_features(*pictures)
    for seed in range(5):
        some = np.random.default_rng(seed).permutation(len(left))[: len(left) * 3 // 4]
        pose = sg.estimate_pose(left[some], right[some], rig.left, rig.right)
        assert two_views.angle(pose.R, rig.R) <= 2
        assert two_views.angle(pose.t, rig.T) <= 8


def test_features_of_the_built_in_scene(small_scene, raw_folder):
    """Bending lenses, different in both cameras, whose truth is known."""
    left, right = (sg.read_image(raw_folder / f"{side}.png") for side in ("left", "right"))
    points = sg.match_features(left, right)
    pose = sg.estimate_pose(*points, small_scene.rig.left, small_scene.rig.right)
    assert two_views.angle(pose.R, small_scene.rig.R) < 0.1
    assert two_views.angle(pose.t, small_scene.rig.T) < 0.5
