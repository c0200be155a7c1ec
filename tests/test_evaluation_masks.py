import numpy as np
import pytest

from stereo_gpu.errors import InputError
from stereo_gpu.evaluation.masks import consistent, near_jumps, nonoccluded, read_mask
from stereo_gpu.evaluation.truth import read_truth
from stereo_gpu.images import write_png
from stereo_gpu.types import View

NEAR, FAR = 7.0, 2.0


def step(width=30, height=3):
    """A near post at columns 12 to 17 before a far wall, as the left camera sees it."""
    truth = np.full((height, width), FAR, np.float32)
    truth[:, 12:18] = NEAR
    return truth


def step_from_the_right(width=30, height=3):
    """The same scene as the right camera sees it: the post at columns 5 to 10."""
    truth = np.full((height, width), FAR, np.float32)
    truth[:, 5:11] = NEAR
    return truth


def visible_columns():
    """The left camera's columns 0 and 1 lie left of the right picture; the post hides its columns 5 to 10."""
    hidden = [0, 1, *range(7, 12)]  # the wall's column x lands on x - 2; 12 itself is the post
    seen = np.ones(30, bool)
    seen[hidden] = False
    return seen


def test_what_a_post_hides():
    np.testing.assert_array_equal(nonoccluded(step()), [visible_columns()] * 3)
    np.testing.assert_array_equal(consistent(step(), step_from_the_right()), [visible_columns()] * 3)


def test_from_the_right_view_it_is_the_mirror_image():
    mirrored = np.ascontiguousarray(step()[:, ::-1])
    np.testing.assert_array_equal(nonoccluded(mirrored, View.RIGHT), [visible_columns()[::-1]] * 3)
    other = step_from_the_right()[:, ::-1]
    np.testing.assert_array_equal(consistent(mirrored, other, View.RIGHT), [visible_columns()[::-1]] * 3)


def test_nothing_shows_through_a_stretched_surface():
    """A near slope that falls by 0.9 px a column spreads over 1.9 columns a pixel of the right view."""
    truth = np.full((1, 60), 1.0, np.float32)
    slope = 30 - 0.9 * np.arange(10, dtype=np.float32)
    truth[0, 40:50] = slope
    truth[0, 50:] = np.nan
    seen = nonoccluded(truth)[0]
    covered = np.arange(40, 50) - slope  # from 10 to 27.1
    wall = np.arange(40) - 1.0
    np.testing.assert_array_equal(seen[:40], (wall >= 0) & ((wall < covered[0]) | (wall > np.rint(covered[-1]))))
    assert seen[40:50].all() and not seen[50:].any()


def test_a_plane_hides_nothing():
    rows, columns = np.mgrid[:20, :50]
    for slope in (-0.9, -0.3, 0.3, 0.9):
        truth = (8 + slope * (columns - 25) + 0.2 * rows).astype(np.float32)
        lands = columns - truth
        np.testing.assert_array_equal(nonoccluded(truth), (np.rint(lands) >= 0) & (np.rint(lands) < 50))


def test_unknown_truth_is_not_visible():
    truth, other = step(), step_from_the_right()
    truth[1] = np.nan
    other[2] = np.nan
    assert not nonoccluded(truth)[1].any() and nonoccluded(truth)[2].any()
    found = consistent(truth, other)
    assert found[0].any() and not found[1:].any()


def test_near_jumps_by_hand():
    truth = np.zeros((21, 30), np.float32)
    truth[:, 15:] = 2.0
    truth[:, 22:] = 3.99  # a step under 2 px is no jump
    everywhere = np.ones(truth.shape, bool)
    expected = np.zeros(30, bool)
    expected[10:20] = True  # 4 px around columns 14 and 15
    np.testing.assert_array_equal(near_jumps(truth, everywhere), [expected] * 21)
    np.testing.assert_array_equal(near_jumps(truth.T.copy(), everywhere.T), np.array([expected] * 21).T)


def test_near_what_is_occluded_counts_and_what_is_occluded_does_not():
    truth = np.full((21, 30), 5, np.float32)
    visible = np.ones(truth.shape, bool)
    visible[10, 20] = False
    truth[3, 3] = np.nan  # unknown is neither occluded nor a jump
    expected = np.zeros(truth.shape, bool)
    expected[6:15, 16:25] = True
    expected[10, 20] = False
    np.testing.assert_array_equal(near_jumps(truth, visible), expected)


@pytest.mark.parametrize(
    ("pair", "scale", "wrongly_seen", "wrongly_hidden", "disc_too_many", "disc_missing"),
    [("teddy", 4, 0.006, 0.001, 15, 0.08), ("tsukuba", 16, 0.0001, 0.0002, 11, 0)],
)
def test_masks_are_nearly_the_published_ones(
    data, pair, scale, wrongly_seen, wrongly_hidden, disc_too_many, disc_missing
):
    """The published masks know more than the left view's truth, so equality is not to be had."""
    folder = data / "stereo" / pair
    truth = read_truth(folder / "groundtruth.png", scale)
    everything, published, disc = (read_mask(folder / f"{name}.png") for name in ("all", "nonocc", "disc"))
    np.testing.assert_array_equal(np.isfinite(truth), everything)
    found = nonoccluded(truth)
    assert (found & ~published).sum() <= wrongly_seen * published.sum()
    assert (published & ~found).sum() <= wrongly_hidden * published.sum()
    near = near_jumps(truth, published)
    assert (near & ~disc).sum() == disc_too_many
    assert (disc & ~near).sum() <= disc_missing * disc.sum()


def test_a_mask_counts_where_it_is_white(tmp_path):
    levels = np.array([[0, 128, 255], [254, 255, 1], [0, 0, 0]], np.uint8)
    for name, stored in (("grey", levels), ("rgb", np.repeat(levels[..., None], 3, axis=2))):
        write_png(tmp_path / f"{name}.png", stored)
        np.testing.assert_array_equal(read_mask(tmp_path / f"{name}.png"), levels == 255)


@pytest.mark.parametrize(
    ("stored", "says"),
    [
        (np.ones((4, 4), np.uint8), "a.png is 1 at most"),
        (np.full((4, 4), 65535, np.uint16), "a.png has 16 bits"),
        (np.dstack([np.full((4, 4), 255, np.uint8), np.zeros((4, 4, 2), np.uint8)]), "a.png is in colour"),
    ],
)
def test_what_is_no_mask_is_refused(tmp_path, stored, says):
    write_png(tmp_path / "a.png", stored)
    with pytest.raises(InputError, match=says):
        read_mask(tmp_path / "a.png")


def test_sizes_that_differ_are_refused():
    with pytest.raises(InputError, match="one truth is 30 x 3 px, the other view's 31 x 3 px"):
        consistent(step(), step(31))
    with pytest.raises(InputError, match="the mask is 31 x 3 px, the truth 30 x 3 px"):
        near_jumps(step(), np.ones((3, 31), bool))
