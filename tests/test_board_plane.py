"""The truth on a board's plane: against a rendered board whose place is known."""

import cv2
import numpy as np
import pytest
from boards import LEFT, RIGHT, SIZE, moved, poses, render

from stereo_gpu.boards.board import Board
from stereo_gpu.errors import StageError
from stereo_gpu.evaluation.board_plane import find_plane, visible
from stereo_gpu.rectify import plan_rectification
from stereo_gpu.rig import Camera, Rig

BOARD = Board(9, 7, 30.0)
TURN = np.array([[0.9998, 0.0, 0.02], [0.0, 1.0, 0.0], [-0.02, 0.0, 0.9998]])
SHIFT = np.array([-60.0, 1.5, 2.0])
CLOSE_PX = 0.1  # corners of a rendered board are found to some hundredths of a pixel


@pytest.fixture(scope="module")
def rig():
    u, _, v = np.linalg.svd(TURN)
    return Rig(left=Camera(*LEFT, SIZE), right=Camera(*RIGHT, SIZE), R=u @ v, T=SHIFT)


@pytest.fixture(scope="module", params=[0.0, np.pi])
def seen(request, rig):
    """A pair of pictures and where the board is, upright and upside down."""
    pose = next(iter(poses(BOARD, 1, seed=3, turned=request.param)))
    return render(BOARD, LEFT, *pose), render(BOARD, RIGHT, *moved(*pose, rig.R, rig.T)), pose


def true_disparity(rig, pose):
    """Disparity of the board's plane at each pixel of the rectified left view, and its place there in squares."""
    plan = plan_rectification(rig)
    rotation = plan.rotation_left @ cv2.Rodrigues(pose[0])[0]
    origin = plan.rotation_left @ pose[1]
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    rays = np.stack([x - plan.cx_left, y - plan.cy, np.full(x.shape, plan.focal_px)], axis=-1) / plan.focal_px
    depth = (rotation[:, 2] @ origin) / (rays @ rotation[:, 2])
    place = (rays * depth[..., None] - origin) @ rotation[:, :2] / BOARD.square + 1
    return plan.focal_px * plan.baseline / depth, place


def test_disparity_is_that_of_the_plane(rig, seen):
    left, right, pose = seen
    plane = find_plane(left, right, rig, BOARD)
    disparity, _ = true_disparity(rig, pose)
    on_board = np.isfinite(plane.truth)
    assert on_board.mean() > 0.1
    assert np.abs(plane.truth - disparity)[on_board].max() < CLOSE_PX
    assert np.abs(plane.residuals).max() < 2 * CLOSE_PX
    assert np.abs(plane.rows).max() < 2 * CLOSE_PX
    low, high = plane.span
    assert low == pytest.approx(disparity[on_board].min(), abs=CLOSE_PX)
    assert high == pytest.approx(disparity[on_board].max(), abs=CLOSE_PX)


def test_outline_is_that_of_all_squares_as_far_as_both_cameras_see_them(rig, seen):
    left, right, pose = seen
    plane = find_plane(left, right, rig, BOARD)
    disparity, place = true_disparity(rig, pose)
    far = np.abs(place - [BOARD.columns / 2, BOARD.rows / 2]) - [BOARD.columns / 2, BOARD.rows / 2]
    partner = np.arange(SIZE[0]) - disparity
    expected = (far.max(axis=-1) <= 0) & (partner >= 0) & (partner <= SIZE[0] - 1)
    # The outline may be off by a fraction of a pixel: a share of what lies along it.
    assert (np.isfinite(plane.truth) != expected).sum() < 0.01 * expected.sum()


def test_pixels_without_content_do_not_count(rig, seen):
    left, right, _ = seen
    plane = find_plane(left, right, rig, BOARD)
    valid_left, valid_right = (np.ones(plane.truth.shape, np.uint8) for _ in range(2))
    np.testing.assert_array_equal(visible(plane, valid_left, valid_right), plane.truth)
    y, x = np.argwhere(np.isfinite(plane.truth))[0]
    valid_left[y, x] = 0
    other_y, other_x = np.argwhere(np.isfinite(plane.truth))[-1]
    valid_right[other_y, round(other_x - plane.truth[other_y, other_x])] = 0
    left_out = np.isfinite(plane.truth) & ~np.isfinite(visible(plane, valid_left, valid_right))
    assert left_out[y, x] and left_out[other_y, other_x]
    assert left_out.sum() <= 3  # two neighbours may share a partner


def test_a_picture_without_a_board_is_refused(rig, seen):
    with pytest.raises(StageError, match="no whole board of 9x7 squares"):
        find_plane(seen[0], np.full_like(seen[1], 120), rig, BOARD)
