"""Whether a rectified pair holds together: pictures of a noise texture, moved by known amounts."""

import cv2
import numpy as np
import pytest

from stereo_gpu.check import check_rectified, refuse_swapped
from stereo_gpu.epipolar.consensus import ENOUGH
from stereo_gpu.errors import InputError, PictureError

NEAR = 12  # px of disparity of the whole texture
FOUND_PX = 0.3  # of SIFT's positions, median


def moved(right_by, down_by=0, size=(200, 300), seed=3):
    """A texture and a copy: what the first shows at (x, y), the copy shows at (x - right_by, y + down_by)."""
    height, width = size
    noise = np.random.default_rng(seed).integers(0, 256, (height + 40, width + 80)).astype(np.float32)
    texture = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2), None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    left = texture[20 : 20 + height, 40 : 40 + width]
    right = texture[20 - down_by : 20 - down_by + height, 40 + right_by : 40 + right_by + width]
    return left.copy(), right.copy()


def test_a_good_pair():
    found = check_rectified(*moved(NEAR))
    assert found.matches >= ENOUGH
    assert found.vertical_px < FOUND_PX
    assert found.behind < 0.05
    assert not found.swapped
    refuse_swapped(found)


@pytest.mark.parametrize("down", [-3, 3])
def test_rows_three_apart(down):
    found = check_rectified(*moved(NEAR, down))
    assert found.vertical_px == pytest.approx(3, abs=FOUND_PX)
    assert not found.swapped


def test_swapped_is_refused():
    left, right = moved(NEAR)
    found = check_rectified(right, left)
    assert found.swapped
    with pytest.raises(InputError, match=r"look swapped: \d+% of \d+ matched points .* left camera's picture first"):
        refuse_swapped(found)


def test_infinity_may_lie_at_any_disparity():
    left, right = moved(-5)
    assert check_rectified(left, right).swapped
    assert not check_rectified(left, right, offset_px=-20).swapped
    assert check_rectified(*moved(NEAR), offset_px=30).swapped


def test_nothing_is_concluded_from_few_features():
    flat = np.full((200, 300), 80, np.uint8)
    left, _ = moved(NEAR)
    unlike, _ = moved(NEAR, seed=4)
    for pair in ((flat, flat), (left, flat), (left, unlike), (left[:12, :12], left[:12, :12])):
        found = check_rectified(*pair)
        assert found.matches < ENOUGH
        assert np.isnan(found.vertical_px) and np.isnan(found.behind)
        assert not found.swapped


def test_large_and_deep_pictures_are_measured_in_their_own_pixels():
    left, right = (cv2.resize(p, None, fx=8, fy=8, interpolation=cv2.INTER_CUBIC) for p in moved(NEAR, 1))
    found = check_rectified(left, right)
    assert found.vertical_px == pytest.approx(8, abs=8 * FOUND_PX)
    deep = check_rectified(*(p.astype(np.uint16) * 16 for p in moved(NEAR, 3)))
    assert deep.vertical_px == pytest.approx(3, abs=FOUND_PX)


def test_pictures_of_two_sizes_are_refused():
    left, right = moved(NEAR)
    with pytest.raises(PictureError, match="two pictures of one size"):
        check_rectified(left, right[:-1])
