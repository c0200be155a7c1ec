import numpy as np
import pytest

from stereo_gpu import figures
from stereo_gpu.errors import InputError, PictureError
from stereo_gpu.types import Validity


def ramp():
    values = np.tile(np.linspace(10, 50, 101, dtype=np.float32), (61, 1))
    values[:20, :30] = np.nan
    return values


def test_disparity_near_is_red_far_is_blue_and_nothing_is_grey():
    picture = figures.colour_disparity(ramp(), 5, 55)
    assert picture.shape == (61, 101, 3) and picture.dtype == np.uint8
    assert (picture[:20, :30] == figures.NO_VALUE).all()
    near, far = picture[40, 95].astype(int), picture[40, 3].astype(int)
    assert near[0] > near[2] + 80
    assert far[2] > far[0] + 30


def test_disparity_range_ignores_a_stray():
    values = ramp()
    stray = values.copy()
    stray[60, 100] = 9000
    same = figures.colour_disparity(values)[:59] == figures.colour_disparity(stray)[:59]
    assert same.mean() > 0.95


def test_disparity_with_fixed_range_is_comparable():
    shifted = figures.colour_disparity(ramp() + 4, 0, 64)
    assert (shifted[40, 20] == figures.colour_disparity(ramp(), 0, 64)[40, 30]).all()


@pytest.mark.parametrize("values", [np.full((30, 40), np.nan, np.float32), np.full((30, 40), 7, np.float32)])
def test_disparity_without_a_range(values):
    assert figures.colour_disparity(values).shape == (30, 40, 3)
    assert figures.colour_disparity(values, bar=True).shape == (30, 104, 3)
    assert figures.histogram(values).shape == (240, 640, 3)


def test_level_lines_cross_both_pictures():
    left = np.full((120, 90), 128, np.uint8)
    right = np.full((120, 90), 40000, np.uint16)
    plain = figures.side_by_side(left, right)
    lined = figures.side_by_side(left, right, level_lines=True)
    assert plain.shape == (120, 188, 3)
    assert tuple(plain[5, 150]) == (156, 156, 156)
    rows = np.flatnonzero((plain != lined).any(axis=(1, 2)))
    np.testing.assert_array_equal(rows, np.arange(10, 120, 10))
    for row in rows:
        assert (lined[row] == lined[row, 0]).all()


def test_masked_keeps_what_the_mask_keeps():
    random = np.random.default_rng(1)
    picture = random.integers(0, 255, (40, 50, 3), np.uint8)
    mask = np.zeros((40, 50), np.uint8)
    mask[10:20, 5:30] = 255
    shown = figures.masked(picture, mask)
    assert (shown[mask > 0] == picture[mask > 0]).all()
    assert shown[mask == 0].min() >= 215


def test_validity_says_the_strongest_reason():
    validity = np.zeros((50, 400), np.uint8)
    validity[:10] = Validity.MASKED | Validity.OUT_OF_RANGE
    validity[10:20] = Validity.OCCLUDED
    picture = figures.colour_validity(validity)
    assert (picture[:10] == figures.VALIDITY_COLOURS["masked"][1]).all()
    assert (picture[10:20] == figures.VALIDITY_COLOURS["occluded"][1]).all()
    assert (picture[20:50] == figures.VALIDITY_COLOURS["good"][1]).all()
    assert picture.shape[0] > 50 and picture.shape[1] == 400
    assert figures.colour_validity(validity, legend=False).shape == (50, 400, 3)


def test_every_reason_has_a_colour_of_its_own():
    bits = {bit for bit, _ in figures.VALIDITY_COLOURS.values()}
    assert bits == {0, *Validity}
    assert len({colour for _, colour in figures.VALIDITY_COLOURS.values()}) == len(bits)


def test_confidence_brightens():
    picture = figures.colour_confidence(np.array([[0.0, 0.5, 1.0, np.nan]], np.float32))
    brightness = picture[0].astype(int).sum(axis=1)
    assert brightness[0] < brightness[1] < brightness[2]
    assert brightness[3] == brightness[0]


def test_histogram_peaks_where_the_values_are():
    random = np.random.default_rng(2)
    values = np.concatenate([random.uniform(0, 100, 2000), random.normal(75, 2, 8000)]).astype(np.float32)
    picture = figures.histogram(values, size=(400, 200))
    filled = ((picture.max(axis=2).astype(int) - picture.min(axis=2)) > 40).sum(axis=0)
    assert abs(int(np.argmax(filled)) - (16 + 0.75 * 368)) < 15


def test_errors():
    grey = np.zeros((10, 12), np.uint8)
    with pytest.raises(PictureError, match="heights 10 and 11"):
        figures.side_by_side(grey, np.zeros((11, 12), np.uint8))
    with pytest.raises(PictureError, match="differ"):
        figures.masked(grey, np.zeros((9, 12)))
    with pytest.raises(PictureError, match="shape"):
        figures.as_rgb(np.zeros((4, 5, 4), np.uint8))
    with pytest.raises(PictureError, match="float32"):
        figures.as_rgb(np.zeros((4, 5), np.float32))
    with pytest.raises(InputError, match="too small"):
        figures.histogram(np.zeros(5, np.float32), size=(10, 10))
