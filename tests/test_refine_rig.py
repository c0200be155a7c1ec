"""Correcting a small drift from a pair: a known one is undone, a good rig stays, and what cannot be seen is said."""

import dataclasses
import json

import cv2
import numpy as np
import pytest

import stereo_gpu as sg
from stereo_gpu.deviations import CameraDeviations, Deviations
from stereo_gpu.epipolar.drift import Drift, drifted
from stereo_gpu.epipolar.rows import find_rows, focal_length, rays, rectifying_rotations
from stereo_gpu.errors import InputError

TURN_OFF_DEG = 0.08  # pitch and roll come back so near; the cup's own rig is off by half of that
GOOD_PX = 0.25


@pytest.fixture(scope="module")
def cup(data):
    """The raw pair, and the calibration that its owner published."""
    folder = data / "rigs" / "cup"
    file = cv2.FileStorage(str(folder / "published_opencv.yml"), cv2.FILE_STORAGE_READ)
    values = {name: file.getNode(name).mat() for name in ("K1", "D1", "K2", "D2", "R", "T")}
    cameras = [sg.Camera(values[f"K{i}"], values[f"D{i}"].ravel(), (640, 480)) for i in (1, 2)]
    pair = [sg.read_image(folder / "test_images" / f"{side}Pic.jpg") for side in ("left", "right")]
    return *pair, sg.Rig(*cameras, values["R"], values["T"].ravel())


@pytest.fixture(scope="module")
def scene(small_scene, raw_folder):
    """A rendered pair with texture all over the frame, and its true rig."""
    return *(sg.read_image(raw_folder / f"{side}.png") for side in ("left", "right")), small_scene.rig


def perturbed(rig, turn, move=(0.0, 0.0)):
    """The rig as if its right camera had turned and moved, degrees."""
    return drifted(rig, Drift(turn=np.array(turn), move=np.array(move), deviations=np.zeros(5)))


def turn_between(a, b):
    """Rotation vector from the one rig's right camera to the other's, degrees."""
    return np.degrees(cv2.Rodrigues(a.R @ b.R.T)[0].ravel())


@pytest.mark.parametrize("turn", [(0.3, 0.0, 0.0), (0.0, 0.0, 0.3), (-0.2, 0.0, 0.4)])
def test_a_turned_camera_of_the_cup_rig_is_turned_back(cup, turn):
    left, right, rig = cup
    refined = sg.refine_rig(left, right, perturbed(rig, turn))
    assert refined.changed
    assert refined.after_px <= GOOD_PX < refined.before_px
    assert np.abs(turn_between(refined.rig, rig)).max() <= TURN_OFF_DEG
    assert refined.rig.baseline == pytest.approx(rig.baseline, rel=1e-12)
    assert refined.drift.turn[[0, 2]] == pytest.approx(-np.array(turn)[[0, 2]], abs=TURN_OFF_DEG)
    # Yaw barely shows in these rows, and would change all depths.
    assert refined.drift.turn[1] == 0 and "yaw, down, forward do not show" in refined.says
    checked = sg.check_rig(left, right, refined.rig)
    assert checked.vertical_px <= GOOD_PX


def test_all_five_numbers_come_back_where_features_fill_frame_and_depth(cup):
    """Points of known places at many depths, seen with 0.1 px of noise, one in ten of them elsewhere."""
    left, right, rig = cup
    random = np.random.default_rng(3)
    depth = 1 / random.uniform(1 / 2000, 1 / 250, 400)
    points = np.column_stack([random.uniform(-0.7, 0.7, 400), random.uniform(-0.55, 0.55, 400), np.ones(400)])
    points *= depth[:, None]
    eye = cv2.projectPoints(points, np.zeros(3), np.zeros(3), rig.left.matrix, rig.left.distortion)[0].reshape(-1, 2)
    other = cv2.projectPoints(points, cv2.Rodrigues(rig.R)[0], rig.T, rig.right.matrix, rig.right.distortion)[0]
    seen_left, seen_right = (side.reshape(-1, 2) + random.normal(0, 0.1, (400, 2)) for side in (eye, other))
    seen_right[::10, 1] += random.uniform(-3, 3, 40)
    spoilt = perturbed(rig, (-0.4, 0.4, -0.3), (-0.4, 0.6))
    rows = find_rows(rays(seen_left, rig.left), rays(seen_right, rig.right), spoilt.R, spoilt.T, focal_length(rig))
    checked = dataclasses.replace(
        sg.check_rig(left, right, spoilt), points_left=seen_left, points_right=seen_right, vertical=rows.vertical
    )
    refined = sg.refine_rig(left, right, spoilt, checked=checked)
    assert refined.changed and "yaw" in refined.says and "do not show" not in refined.says
    off = turn_between(refined.rig, rig)
    assert np.abs(off[[0, 2]]).max() <= 0.02 and abs(off[1]) <= 0.05
    places = [-r.R.T @ r.T / r.baseline for r in (refined.rig, rig, spoilt)]
    apart = [np.degrees(np.arccos(np.clip(place @ places[1], -1, 1))) for place in (places[0], places[2])]
    assert apart[0] <= 0.1 < 0.5 < apart[1]
    assert refined.after_px < 0.2 < 1 < refined.before_px
    # The words give the same numbers, each with a deviation that does not promise too much.
    assert (np.abs(refined.drift.turn - [0.4, -0.4, 0.3]) <= 4 * refined.drift.deviations[:3] + 0.005).all()
    assert f"pitch {refined.drift.turn[0]:+.2f} ± " in refined.says


def test_a_good_rig_stays(cup, scene):
    for left, right, rig in (cup, scene):
        refined = sg.refine_rig(left, right, rig)
        assert refined.after_px <= refined.before_px
        if not refined.changed:
            assert refined.rig is rig and "nothing to correct" in refined.says
            assert not refined.drift.turn.any()
        assert np.abs(turn_between(refined.rig, rig)).max() <= TURN_OFF_DEG
        assert sg.check_rig(left, right, refined.rig).vertical_px <= 1.05 * refined.before_px


def test_features_held_out_had_no_part(cup):
    """Every feature is moved at random: no turn helps those that are held out, and the rig stays."""
    left, right, rig = cup
    checked = sg.check_rig(left, right, rig)
    random = np.random.default_rng(2)
    moved = checked.points_right.copy()
    moved[:, 1] += random.normal(0, 1, len(moved))
    rows = find_rows(rays(checked.points_left, rig.left), rays(moved, rig.right), rig.R, rig.T, focal_length(rig))
    noisy = dataclasses.replace(checked, points_right=moved, vertical=rows.vertical)
    refined = sg.refine_rig(left, right, rig, checked=noisy)
    assert not refined.changed and refined.rig is rig


def test_what_is_no_small_drift_is_refused(cup):
    left, right, rig = cup
    flat = np.full_like(left, 90)
    middle = left.copy(), right.copy()
    for picture, columns in zip(middle, (slice(360, 520), slice(300, 460)), strict=True):
        blank = np.full_like(picture, 90)
        blank[200:320, columns] = picture[200:320, columns]
        picture[:] = blank
    matrix = rig.right.matrix.copy()
    matrix[:2, :2] *= 1.1
    zoomed = dataclasses.replace(rig, right=sg.Camera(matrix, rig.right.distortion, rig.right.size))
    for pair, given, says in (
        ((flat, flat), rig, "nothing can be said"),
        ((right, left), rig, "look swapped"),
        (middle, rig, "of both are needed"),
        ((left, right), perturbed(rig, (3.0, 0.0, 2.0)), "no small turn"),
        ((left, right), zoomed, "no small turn"),
    ):
        with pytest.raises(InputError, match="cannot be refined") as caught:
            sg.refine_rig(*pair, given)
        assert says in str(caught.value)


def test_deviations_grow_by_those_of_the_correction(cup):
    left, right, rig = cup
    camera = CameraDeviations(fx=0.1, fy=0.1, cx=0.2, cy=0.2, distortion=np.full(5, 1e-3))
    before = Deviations(left=camera, right=camera, om=np.full(3, 1e-4), T=np.full(3, 0.02))
    refined = sg.refine_rig(left, right, dataclasses.replace(perturbed(rig, (0.3, 0, 0)), deviations=before))
    after = refined.rig.deviations
    expected = np.hypot(1e-4, np.radians(refined.drift.deviations[:3]))
    np.testing.assert_allclose(after.om, expected)
    assert after.om[0] > before.om[0] and after.om[1] == before.om[1]
    np.testing.assert_allclose(after.T, before.T)
    assert json.loads(json.dumps(refined.record(), allow_nan=False))["changed"] is True


def test_rectifying_rotations_are_those_of_opencv():
    random = np.random.default_rng(4)
    for _ in range(50):
        rotation = cv2.Rodrigues(random.normal(0, 0.2, 3))[0]
        translation = np.array([random.choice([-1.0, 1.0]), *random.uniform(-0.3, 0.3, 2)]) * random.uniform(0.1, 100)
        ideal = np.eye(3)
        known = cv2.stereoRectify(ideal, None, ideal, None, (640, 480), rotation, translation.reshape(3, 1))[:2]
        for ours, theirs in zip(rectifying_rotations(rotation, translation), known, strict=True):
            np.testing.assert_allclose(ours, theirs, atol=1e-12)


def test_rays_invert_the_lens():
    random = np.random.default_rng(5)
    matrix = np.array([[400.0, 0, 310], [0, 405, 245], [0, 0, 1]])
    for distortion in (
        [-0.35, 0.15, 1e-3, -1e-3, -0.03],
        [0.2, -0.1, 0, 0, 0.02, 0.3, 0.02, 0.01],
        [0.1, 0.02, 1e-3, 2e-3, 0, 0.2, 0.01, 0, 1e-3, 0, -1e-3, 0],
    ):
        camera = sg.Camera(matrix, np.array(distortion), (640, 480))
        true = np.column_stack([random.uniform(-0.75, 0.75, 300), random.uniform(-0.55, 0.55, 300)])
        seen = cv2.projectPoints(
            np.column_stack([true, np.ones(300)]), np.zeros(3), np.zeros(3), matrix, camera.distortion
        )[0].reshape(-1, 2)
        np.testing.assert_allclose(rays(seen, camera), true, atol=1e-5)
    # A lens model that folds back has no ray for a point outside of its fold.
    folded = sg.Camera(matrix, np.array([-1.0, 0, 0, 0, 0]), (640, 480))
    assert np.isnan(rays(np.array([[5000.0, 245.0]]), folded)).all()
    assert rays(np.zeros((0, 2)), camera).shape == (0, 2)
