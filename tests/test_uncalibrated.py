"""A rig from a pair alone: rows must correspond where nothing was fitted, and left and right be told apart."""

import numpy as np
import pytest
import two_views

import stereo_gpu as sg
from stereo_gpu.epipolar.features import match_features
from stereo_gpu.epipolar.pose import inverse_depths, undistort
from stereo_gpu.epipolar.sharpen import sharpen_matches
from stereo_gpu.epipolar.uncalibrated import rig_from_pair, rig_from_points, vertical_errors
from stereo_gpu.errors import InputError, PictureError, StageError
from stereo_gpu.rectify import plan_rectification, rectify

BOUND_PX = 0.5  # of the issue
PAIRS = {
    "cup": ("rigs/cup/test_images/leftPic.jpg", "rigs/cup/test_images/rightPic.jpg"),
    "board": ("calibration/board_10x7/left01.jpg", "calibration/board_10x7/right01.jpg"),
    "teddy": ("stereo/teddy/im2.png", "stereo/teddy/im6.png"),
    "motorcycle": ("stereo/motorcycle/motorcycle_left.png", "stereo/motorcycle/motorcycle_right.png"),
    "aloe": ("stereo/aloe_light/left.png", "stereo/aloe_light/right.png"),
}


@pytest.fixture(scope="module", params=PAIRS)
def halves(request, data):
    """What half of a real pair's matches give, those matches, and the others."""
    left, right = (sg.read_image(data / path) for path in PAIRS[request.param])
    points = sharpen_matches(left, right, *match_features(left, right))
    order = np.random.default_rng(0).permutation(len(points[0]))
    ours, others = ([side[half] for side in points] for half in (order[::2], order[1::2]))
    return rig_from_points(*ours, (left.shape[1], left.shape[0])), ours, others


def test_rows_of_matches_that_were_held_out(halves):
    found, ours, others = halves
    assert np.median(np.abs(vertical_errors(found.rig, *others))) <= BOUND_PX
    assert found.vertical_px <= BOUND_PX
    assert found.rig.unit == "baselines"
    assert found.rig.baseline == pytest.approx(1)
    assert found.rig.T[0] < -0.95
    assert two_views.angle(found.rig.R, np.eye(3)) < 4
    assert (found.focal_px, found.focal_known) == (max(found.rig.left.size), False)
    assert found.matches == len(ours[0]) >= len(found.points_left) == len(found.points_right)


def test_the_picture_keeps_its_shape(halves):
    """Rectified, neither picture is stretched by more than a few percent anywhere."""
    rig = halves[0].rig
    plan = plan_rectification(rig)
    places = np.array([[x, y] for x in (0.1, 0.5, 0.9) for y in (0.1, 0.5, 0.9)]) * rig.left.size
    for camera, turn in ((rig.left, plan.rotation_left), (rig.right, plan.rotation_right)):
        moved = []
        for step in ((0, 0), (1, 0), (0, 1)):
            rays = np.column_stack([undistort(places + step, camera), np.ones(9)]) @ turn.T
            moved.append(plan.focal_px * rays[:, :2] / rays[:, 2:])
        stretched = np.linalg.svd(np.stack([moved[1] - moved[0], moved[2] - moved[0]], axis=2), compute_uv=False)
        # Bent lenses are straightened, which stretches the border by more.
        assert (np.abs(stretched - 1) < (0.3 if camera.distortion[0] else 0.06)).all()


def test_swapped_pictures_are_told(data):
    left, right = (sg.read_image(data / path) for path in PAIRS["cup"])
    with pytest.raises(InputError, match=r"the pictures look swapped: \d+% .* give the left camera's picture first"):
        rig_from_pair(right, left)


def test_cup_against_its_published_rig(data):
    left, right = (sg.read_image(data / path) for path in PAIRS["cup"])
    found = rig_from_pair(left, right, focal_px=387.0)
    assert (found.focal_px, found.focal_known) == (387.0, True)
    assert two_views.angle(found.rig.R, np.eye(3)) < 1  # published: 0.36 degrees
    assert two_views.angle(found.rig.T, np.array([-49.3, 0.04, -0.14])) < 4
    pair = rectify(left, right, found.rig)
    rows = sharpen_matches(pair.left, pair.right, *match_features(pair.left, pair.right))
    assert np.median(np.abs(rows[0][:, 1] - rows[1][:, 1])) <= BOUND_PX
    assert (rows[0][:, 0] > rows[1][:, 0]).mean() > 0.95  # disparities are above zero
    assert pair.valid_left.mean() > 0.95


def test_known_cameras_come_back():
    """The lens and the principal point are as assumed: rotation, direction and lens come out."""
    matrix = np.array([[600.0, 0, 319.5], [0, 600.0, 239.5], [0, 0, 1]])
    for k1 in (0.0, -0.25):
        camera = sg.Camera(matrix, np.array([k1, 0, 0, 0, 0]), two_views.SIZE)
        rig = sg.Rig(camera, camera, two_views.R, two_views.T)
        left, right = two_views.see(rig, two_views.room(250), 0.2)
        right[::5] = np.random.default_rng(0).uniform(0, 480, (50, 2))
        found = rig_from_points(left, right, two_views.SIZE, focal_px=600.0)
        assert two_views.angle(found.rig.R, rig.R) < 0.5
        assert two_views.angle(found.rig.T, rig.T) < 2
        assert found.rig.left.distortion[0] == pytest.approx(k1, abs=0.05)
        depths = 1 / inverse_depths(
            found.rig.R, found.rig.T, undistort(found.points_left, camera), undistort(found.points_right, camera)
        )
        assert np.median(depths) * rig.baseline == pytest.approx(5.5, rel=0.1)


def test_one_place_is_told():
    still = sg.Rig(two_views.camera(), two_views.camera(), two_views.R, np.array([-1e-7, 0, 0]))
    left, right = two_views.see(still, two_views.room(100), 0.2)
    for points in ((left, right), (left, left)):
        with pytest.raises(StageError, match="taken from one place"):
            rig_from_points(*points, two_views.SIZE)


@pytest.mark.parametrize(
    ("T", "told"),
    [
        ([0.02, -0.5, 0.0], "above or below the other .*turn both upright: EXIF's orientation is ignored"),
        ([0.0, 0.05, 0.5], "in front of or behind the other .*between the pictures$"),
    ],
)
def test_cameras_above_or_behind_each_other(T, told):
    rig = sg.Rig(two_views.camera(), two_views.camera(), np.eye(3), np.array(T))
    left, right = two_views.see(rig, two_views.room(150), 0.1)
    with pytest.raises(InputError, match=f"one camera stands {told}"):
        rig_from_points(left, right, two_views.SIZE)


def test_refused():
    random = np.random.default_rng(0)
    flat = np.full((120, 160), 90, np.uint8)
    with pytest.raises(StageError, match=r"0 features match, 30 are needed"):
        rig_from_pair(flat, flat)
    with pytest.raises(PictureError, match="give two pictures of one size"):
        rig_from_pair(flat, flat[:100])
    with pytest.raises(PictureError, match="left is 1 x 1 px"):
        rig_from_pair(flat[:1, :1], flat[:1, :1])
    left, right = two_views.see(two_views.rig(), two_views.room(60), 0.1)
    for focal in (0.0, 4.5, -600.0, np.nan, np.inf, 1e9):
        with pytest.raises(InputError, match=r"the focal length is .* give it in px, not mm"):
            rig_from_points(left, right, two_views.SIZE, focal_px=focal)
    with pytest.raises(StageError, match=r"fits \d+ of 80 matches to .* not enough"):
        rig_from_points(*random.uniform(0, 480, (2, 80, 2)), two_views.SIZE)
