"""Matched features: where they are, and that nothing breaks where there are none."""

import cv2
import numpy as np
import pytest

from stereo_gpu.epipolar.features import match_features
from stereo_gpu.errors import PictureError
from stereo_gpu.images import read_image


def texture(height, width, seed=3):
    noise = np.random.default_rng(seed).integers(0, 256, (height, width)).astype(np.float32)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2), None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def shifted(right_by, down_by, size=(220, 320)):
    """A texture and a copy: what the first shows at (x, y), the copy shows at (x - right_by, y - down_by)."""
    height, width = size
    whole = texture(height + 40, width + 40)
    return whole[:height, :width].copy(), whole[down_by : down_by + height, right_by : right_by + width].copy()


def offsets(left, right):
    points = match_features(left, right)
    assert points[0].shape == points[1].shape == (len(points[0]), 2)
    assert points[0].dtype == points[1].dtype == np.float64
    return points[0] - points[1]


def test_matches_are_where_the_pictures_agree():
    off = offsets(*shifted(17, 6))
    assert len(off) > 100
    assert (np.abs(off - [17, 6]).max(axis=1) < 0.5).mean() > 0.95
    assert np.abs(np.median(off, axis=0) - [17, 6]).max() < 0.02


def test_places_have_no_bias():
    """Blobs of known centre: pixel centres lie at whole numbers, which OpenCV's default misses by 0.25 px."""
    y, x = np.mgrid[:300, :400]
    random = np.random.default_rng(5)
    centres = np.array([(40 + 53 * i, 40 + 53 * j) for i in range(7) for j in range(5)]) + random.uniform(0, 1, (35, 2))
    sizes = random.uniform(2.5, 7, 35)
    picture = np.full(x.shape, 60.0)
    for (cx, cy), size in zip(centres, sizes, strict=True):
        picture += 40 * np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / (2 * size**2))
        picture += 90 * np.exp(-((x - cx - 0.8 * size) ** 2 + (y - cy) ** 2) / (2 * (size / 3) ** 2))
    flat = np.clip(picture, 0, 255).astype(np.uint8)
    mirrored = np.ascontiguousarray(flat[::-1, ::-1])
    places = match_features(flat, flat)[0]
    turned = np.array([399, 299]) - match_features(mirrored, mirrored)[0]
    nearest = np.linalg.norm(places[:, None] - turned[None], axis=2)
    off = places - turned[nearest.argmin(axis=1)]
    assert len(off) > 30
    assert np.abs(np.median(off[nearest.min(axis=1) < 1], axis=0)).max() < 0.02


def test_no_place_twice():
    left, right = match_features(*shifted(17, 6))
    assert len(np.unique(np.hstack([left, right]), axis=0)) == len(left)


def test_large_pictures_are_measured_in_their_own_pixels():
    small = shifted(17, 6)
    large = [cv2.resize(picture, None, fx=8, fy=8, interpolation=cv2.INTER_CUBIC) for picture in small]
    assert np.abs(np.median(offsets(*large), axis=0) - [136, 48]).max() < 0.3
    # Centres at whole numbers: an enlarged picture's are at 8 (x + 0.5) - 0.5.
    of_small, of_large = match_features(small[0], small[0])[0], match_features(large[0], large[0])[0]
    carried = 8 * (of_small + 0.5) - 0.5
    off = carried[:, None] - of_large[None]
    near = np.linalg.norm(off, axis=2)
    closest = off[np.arange(len(off)), near.argmin(axis=1)][near.min(axis=1) < 4]
    assert len(closest) > 50
    assert np.abs(np.median(closest, axis=0)).max() < 0.3


def test_colour_16_bit_and_unequal_sizes():
    left, right = shifted(17, 6)
    colour = cv2.cvtColor(right, cv2.COLOR_GRAY2RGB)
    for pair in ((left, colour), (left, right.astype(np.uint16) * 16), (left, right[:150, :250])):
        off = offsets(*pair)
        assert len(off) > 50
        assert np.abs(np.median(off, axis=0) - [17, 6]).max() < 0.05


def test_nothing_to_match():
    left, _ = shifted(17, 6)
    flat = np.full((200, 300), 80, np.uint8)
    other = texture(200, 300, seed=9)
    for pair in ((flat, flat), (left, flat), (flat, left), (left[:3, :3], left), (left[:12, :12], flat)):
        points = match_features(*pair)
        assert points[0].shape == points[1].shape == (0, 2)
    assert len(match_features(left, other)[0]) < 20  # of some 500


@pytest.mark.parametrize(
    "bad", ["left.png", None, np.zeros((5, 5)), np.zeros((1, 1), np.uint8), np.zeros((5, 5, 2), np.uint8)]
)
def test_no_picture(bad):
    left, _ = shifted(17, 6)
    with pytest.raises(PictureError, match=r"^left is|^left holds|^left has"):
        match_features(bad, left)
    with pytest.raises(PictureError, match=r"^right is|^right holds|^right has"):
        match_features(left, bad)


def test_rows_of_a_rectified_real_pair_agree(data):
    folder = data / "stereo" / "motorcycle"
    left, right = match_features(*(read_image(folder / f"motorcycle_{side}.png") for side in ("left", "right")))
    assert len(left) > 800
    assert np.median(np.abs(left[:, 1] - right[:, 1])) < 0.2
