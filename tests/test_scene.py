"""The built-in scene: its truth agrees with itself, and its pictures with its truth."""

import cv2
import numpy as np
import pytest

from stereo_gpu.errors import InputError
from stereo_gpu.rig import Camera, Rig
from stereo_gpu.scene import build_scene, project, trace, undistort
from stereo_gpu.scene_objects import Box, Ellipsoid, Paint, Thing, turn
from stereo_gpu.scene_render import render_boards, render_pair
from stereo_gpu.scene_truth import measure_calibration, measure_surface, surface_distance, truth, visible_from
from stereo_gpu.types import RectifiedPair

EXACT_PX = 1e-6  # of the lens's inverse
CORNER_PX = 0.06  # rms of corners found at 640x480: what OpenCV's refinement reaches on these boards
FOUND_PX = 0.25  # median error of SGBM's disparities at 320x240: it leans towards whole pixels
BIAS_PX = 0.05  # and to neither side
RNG_SEED = 20


@pytest.fixture(scope="module")
def scene():
    return build_scene()


@pytest.fixture(scope="module")
def small():
    return build_scene((320, 240))


@pytest.fixture(scope="module")
def pictures(small):
    return render_pair(small)


@pytest.fixture(scope="module")
def boards(scene):
    return render_boards(scene)


def rectified(rig, left, right):
    """OpenCV's own rectification, so that these tests need no device."""
    cameras, pose = (rig.left, rig.right), (rig.R, rig.T[:, None])
    lenses = [value for camera in cameras for value in (camera.matrix, camera.distortion)]
    plan = cv2.stereoRectify(*lenses, rig.left.size, *pose, flags=cv2.CALIB_ZERO_DISPARITY, alpha=-1)
    rotations, matrices = plan[:2], plan[2:4]
    shown, valid = [], []
    for picture, camera, rotation, matrix in zip((left, right), cameras, rotations, matrices, strict=True):
        maps = cv2.initUndistortRectifyMap(
            camera.matrix, camera.distortion, rotation, matrix, camera.size, cv2.CV_32FC1
        )
        shown.append(cv2.remap(picture, *maps, cv2.INTER_LINEAR))
        inside = cv2.remap(np.full(picture.shape[:2], 255, np.uint8), *maps, cv2.INTER_LINEAR)
        valid.append((inside == 255).astype(np.uint8))
    return RectifiedPair(
        left=shown[0],
        right=shown[1],
        valid_left=valid[0],
        valid_right=valid[1],
        rotation_left=rotations[0],
        rotation_right=rotations[1],
        focal_px=matrices[0][0, 0],
        baseline=-matrices[1][0, 3] / matrices[1][0, 0],
        cx_left=matrices[0][0, 2],
        cx_right=matrices[1][0, 2],
        cy=matrices[0][1, 2],
    )


@pytest.fixture(scope="module")
def pair(small, pictures):
    return rectified(small.rig, *pictures)


def true_points(pair, depth, reference):
    cx = pair.cx_left if reference == "left" else pair.cx_right
    shift = 0 if reference == "left" else pair.baseline
    y, x = np.mgrid[: depth.shape[0], : depth.shape[1]]
    scale = depth / pair.focal_px
    return np.stack([(x - cx) * scale + shift, (y - pair.cy) * scale, depth], axis=-1)


def test_undistort_inverts_the_lens_up_to_the_corners(scene):
    width, height = scene.rig.left.size
    x, y = np.meshgrid(np.linspace(-0.5, width - 0.5, 41), np.linspace(-0.5, height - 0.5, 31))
    pixels = np.stack([x.ravel(), y.ravel()], axis=1)
    for camera in (scene.rig.left, scene.rig.right):
        rays = undistort(camera, pixels)
        back = project(camera, np.column_stack([rays, np.ones(len(rays))]))
        assert np.abs(back - pixels).max() < EXACT_PX


@pytest.mark.parametrize("kind", [Ellipsoid, Box])
def test_rays_meet_a_shape_on_its_surface_and_face_its_normal(kind):
    random = np.random.default_rng(RNG_SEED)
    shape = kind(np.array([3.0, -4, 900]), turn(20, 35, -50).T, np.array([30.0, 55, 80]), Thing.BEAR, Paint.FUR)
    origins = random.uniform(-40, 40, (4000, 3))
    directions = shape.centre + random.uniform(-120, 120, (4000, 3)) - origins
    steps = shape.hit(origins, directions)
    hit = np.isfinite(steps)
    assert 500 < hit.sum() < 3500
    points = origins[hit] + steps[hit, None] * directions[hit]
    assert np.abs(shape.distance(points)).max() < 1e-9
    normals = shape.normal(points)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1)
    assert (np.einsum("ij,ij->i", normals, directions[hit]) < 0).all()
    # just before the hit the ray is outside, and a ray that misses stays outside
    assert (shape.distance(points - 1e-3 * directions[hit]) > 0).all()
    for step in np.linspace(0.1, 3, 60):
        assert (shape.distance(origins[~hit] + step * directions[~hit]) > -1e-9).all()


def test_distance_to_a_sphere_is_exact():
    ball = Ellipsoid(np.zeros(3), np.eye(3), np.full(3, 50.0), Thing.BEAR, Paint.FUR)
    assert ball.distance(np.array([[80.0, 0, 0], [0, 20, 0]])) == pytest.approx([30, -30])


def test_trace_finds_every_thing_and_nothing(scene):
    pixels = np.array([[235.0, 270], [430, 240], [60, 440], [60, 60]])
    rays = np.column_stack([undistort(scene.rig.left, pixels), np.ones(4)])
    depth, things = trace(scene, np.zeros(3), rays)
    assert things.tolist() == [Thing.CUBE, Thing.BEAR, Thing.TABLE, Thing.WALL]
    assert ((depth[:2] > 600) & (depth[:2] < 1000)).all()
    assert np.allclose(trace(scene, np.zeros(3), rays * 2)[0], depth / 2)
    behind, thing = trace(scene, np.zeros(3), np.array([[0, -1.0, -1]]))
    assert np.isinf(behind[0]) and thing[0] == Thing.NOTHING


def test_what_a_camera_sees_is_visible_from_it_and_what_is_behind_is_not(scene):
    pixels = np.array([[235.0, 270], [430, 240]])
    rays = np.column_stack([undistort(scene.rig.left, pixels), np.ones(2)])
    points = rays * trace(scene, np.zeros(3), rays)[0][:, None]
    assert visible_from(scene, points, np.zeros(3)).all()
    assert not visible_from(scene, points * 1.3, np.zeros(3)).any()


def test_pictures_are_the_same_for_one_seed_and_differ_for_another(small, pictures):
    again = render_pair(build_scene((320, 240)))
    other = render_pair(build_scene((320, 240), seed=1))
    for picture, same, different in zip(pictures, again, other, strict=True):
        assert picture.shape == (240, 320, 3) and picture.dtype == np.uint8
        assert np.array_equal(picture, same)
        assert np.abs(picture.astype(int) - different).mean() > 5


def test_boards_are_found_where_they_are(scene, boards):
    assert len(boards) == 15
    for pictures, (rotation, origin) in zip(boards, scene.board_poses, strict=True):
        points = scene.board.points @ rotation.T + origin
        placed = (points, points @ scene.rig.R.T + scene.rig.T)
        for picture, camera, seen in zip(pictures, (scene.rig.left, scene.rig.right), placed, strict=True):
            found = scene.board.find(picture)
            assert found is not None
            corners = found.corners
            true = project(camera, seen)
            # which end comes first is left open
            errors = [np.sqrt(((order - true) ** 2).sum(axis=1).mean()) for order in (corners, corners[::-1])]
            assert min(errors) < CORNER_PX


def test_boards_cover_both_pictures(scene):
    width, height = scene.rig.left.size
    for camera, pose in (
        (scene.rig.left, (np.eye(3), np.zeros(3))),
        (scene.rig.right, (scene.rig.R, scene.rig.T)),
    ):
        corners = np.concatenate(
            [
                project(camera, (scene.board.points @ rotation.T + origin) @ pose[0].T + pose[1])
                for rotation, origin in scene.board_poses
            ]
        )
        assert (corners > 4).all() and (corners < [width - 5, height - 5]).all()
        share = np.ptp(corners, axis=0) / [width, height]
        assert share[0] > 0.65 and share[1] > 0.7  # the rest is the 100 mm that only one camera sees, and the rim


def test_depth_of_the_pictures_is_the_true_depth(pair, small):
    """A matcher that knows nothing of the scene finds the depth that the truth says."""
    known = truth(small, pair, "left")
    matcher = cv2.StereoSGBM.create(16, 48, 5, 200, 800, 1, 0, 10, 100, 2, mode=cv2.STEREO_SGBM_MODE_HH)
    grey = [cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) for picture in (pair.left, pair.right)]
    found = matcher.compute(*grey).astype(np.float64) / 16
    true = pair.focal_px * pair.baseline / known.depth
    clear = known.objects & (found > 16)
    assert clear.sum() > 0.95 * known.objects.sum() > 10_000
    off = (found - true)[clear]
    assert np.median(np.abs(off)) < FOUND_PX
    assert abs(np.median(off)) < BIAS_PX


@pytest.mark.parametrize("reference", ["left", "right"])
def test_the_true_surface_measures_as_perfect(small, pair, reference):
    known = truth(small, pair, reference)
    points = true_points(pair, known.depth, reference).astype(np.float32)
    vertices = points[known.objects][::50]
    figures = measure_surface(small, pair, points, reference=reference, vertices=vertices)
    assert figures["coverage"] == 1
    # the pair's pixels are laid out for the true rig, so only float32 is left
    for name in ("depth_median_percent", "depth_p95_percent"):
        assert figures[name] < 1e-4
    for name in ("surface_median_mm", "mesh_median_mm", "mesh_p95_mm"):
        assert figures[name] < 1e-3


def test_what_is_wrong_with_a_surface_is_measured(small, pair):
    known = truth(small, pair, "right")
    points = true_points(pair, known.depth * 1.01, "right")
    points[known.objects & (np.indices(known.depth.shape).sum(axis=0) % 4 == 0)] = np.nan
    figures = measure_surface(small, pair, points)
    assert figures["coverage"] == pytest.approx(0.75, abs=0.01)
    assert figures["depth_median_percent"] == pytest.approx(1, abs=1e-6)
    assert 2 < figures["surface_median_mm"] < 9  # one percent of 700 to 900 mm, and less where seen at a slant


def test_only_what_both_cameras_see_counts(small, pair):
    for reference in ("left", "right"):
        known = truth(small, pair, reference)
        objects = np.isin(known.things, (Thing.CUBE, Thing.BEAR))
        hidden = objects & ~known.shared
        assert 20 < hidden.sum() < 0.05 * objects.sum()
        assert not (known.objects & hidden).any()


def test_surface_distance_of_moved_points(scene):
    rays = np.column_stack([undistort(scene.rig.left, np.array([[60.0, 440], [430, 240]])), np.ones(2)])
    points = rays * trace(scene, np.zeros(3), rays)[0][:, None]
    distance, things = surface_distance(scene, points)
    assert distance.max() < 1e-9 and things.tolist() == [Thing.TABLE, Thing.BEAR]
    up = scene.rotation[:, 2]
    assert surface_distance(scene, points[:1] + 5 * up)[0] == pytest.approx([5])


def test_the_true_rig_measures_as_perfect(scene):
    figures = measure_calibration(scene, scene.rig)
    assert all(value < 1e-5 for value in figures.values())


def test_what_is_wrong_with_a_rig_is_measured(scene):
    rig = scene.rig
    longer = measure_calibration(scene, Rig(rig.left, rig.right, rig.R, rig.T * 1.01))
    assert longer["baseline_percent"] == pytest.approx(1)
    assert longer["rotation_degrees"] < 1e-6 < longer["rms_px"]
    assert longer["depth_percent"] == pytest.approx(1, abs=0.05)
    tilted = measure_calibration(scene, Rig(rig.left, rig.right, turn(0.1, 0, 0) @ rig.R, rig.T))
    assert tilted["rotation_degrees"] == pytest.approx(0.1)
    assert tilted["vertical_px"] == pytest.approx(0.1 / 180 * np.pi * 650, rel=0.2)
    matrix = rig.left.matrix + np.diag([2, 0, 0])
    wide = Rig(Camera(matrix, rig.left.distortion, rig.left.size), rig.right, rig.R, rig.T)
    assert 0.1 < measure_calibration(scene, wide)["rms_px"] < 1


def test_wrong_input_is_named(scene, small, pair):
    with pytest.raises(InputError, match="100x100"):
        build_scene((100, 100))
    with pytest.raises(InputError, match="320x240"):
        measure_calibration(scene, small.rig)
    with pytest.raises(InputError, match="middle"):
        truth(small, pair, "middle")
    with pytest.raises(InputError, match="shape"):
        measure_surface(small, pair, np.zeros((3, 3, 3)))
