"""Matching as a whole: the paper's pseudo-code, agreement of the devices, accuracy on real pairs, wrong input."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
import reference
from conftest import missing

from stereo_gpu.backends import open_backend
from stereo_gpu.config import PROFILES, Profile
from stereo_gpu.errors import InputError, MemoryLimitError, PictureError
from stereo_gpu.match import match
from stereo_gpu.match_options import check_options
from stereo_gpu.types import Validity


def textured_pair(width, height, seed=0):
    """A random texture on a slope and a step, as two pictures, and the disparity on the left view."""
    rng = np.random.default_rng(seed)
    disparity = 6 + 8 * np.linspace(0, 1, height)[:, None] + np.zeros((height, width))
    disparity[height // 4 : height // 2, width // 3 : width // 2] += 12
    noise = rng.integers(0, 256, (height, width + 64)).astype(np.float32)
    base = cv2.GaussianBlur(noise, (0, 0), 1.2)
    base = (base - base.min()) / (base.max() - base.min()) * 255
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    right = base[:, :width]
    left = cv2.remap(base, x - disparity.astype(np.float32), y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    return left.astype(np.uint8), right.astype(np.uint8), disparity


@pytest.mark.parametrize("view", ["left", "right"])
def test_paper_is_its_pseudo_code(backend, view):
    left, right, _ = textured_pair(47, 31)
    left[10:22, 20:35] = right[10:22, 20:35] = 90
    window, smallest, count = 5, -2, 20
    found = match(
        left, right, disparities=(smallest, count), window=window, reference=view, profile="paper", backend=backend.name
    )
    centred = [picture.astype(float) - 128 for picture in (left, right)]
    ours, theirs = centred if view == "left" else centred[::-1]
    threshold = PROFILES[Profile.PAPER].texture_threshold * window
    direction = -1 if view == "left" else 1
    expected = reference.disp_comp(ours, theirs, smallest, count, window // 2, threshold, direction)
    # The paper writes 0 where nothing correlates, and so does nan_to_num; its median filter sees values alone.
    hole = np.isnan(found.values)
    assert (expected[hole] == 0).all()
    values = np.where(hole, np.nan, expected)
    np.testing.assert_array_equal(found.values, reference.median(values, PROFILES[Profile.PAPER].median))
    assert hole.any()
    assert (found.validity[hole] != 0).all()


@pytest.mark.parametrize("profile", ["fast", "precise"])
@pytest.mark.parametrize("view", ["left", "right"])
def test_devices_agree_on_an_odd_size(view, profile):
    """Same valid pixels but for 0.1 %, the rest within 1e-3 px."""
    left, right, truth = textured_pair(631, 479)
    found = {}
    for name in ("opencl", "warp:cpu"):
        try:
            found[name] = match(
                left, right, disparities=(0, 48), reference=view, profile=profile, backend=open_backend(name).name
            )
        except Exception as error:
            missing(name, str(error))
    a, b = (d.values for d in found.values())
    assert (np.isnan(a) != np.isnan(b)).mean() <= 0.001
    both = np.isfinite(a) & np.isfinite(b)
    assert np.abs(a - b)[both].max() <= 1e-3
    assert both.mean() > 0.9
    if view == "left":
        assert np.nanmedian(np.abs(a - truth)) < 0.1


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
@pytest.mark.parametrize("profile", ["paper", "fast", "precise"])
def test_reference_views_are_equal_in_every_way(profile, depth):
    left, right, _ = textured_pair(120, 80)
    if depth is np.uint16:
        noise = np.random.default_rng(1).integers(0, 60, (2, *left.shape))
        left, right = ((p * 57 + n).astype(np.uint16) for p, n in zip((left, right), noise, strict=True))
    search = {"disparities": (0, 40), "profile": profile}
    straight = match(left, right, reference="left", **search)
    mirrored = match(right[:, ::-1].copy(), left[:, ::-1].copy(), reference="right", **search)
    # The planes of precise lie in a grid that begins on the left.
    tolerance = 1e-2 if profile == "precise" else 0
    same = np.isclose(straight.values, mirrored.values[:, ::-1], rtol=0, atol=tolerance, equal_nan=True)
    assert same.mean() >= (0.999 if profile == "precise" else 1)
    np.testing.assert_array_equal(straight.validity[same], mirrored.validity[:, ::-1][same])


def test_refuses_slopes_that_no_path_can_follow():
    with pytest.raises(InputError, match="row_slopes"):
        check_options(dataclasses.replace(PROFILES[Profile.PRECISE], row_slopes=(0, 4)))


def test_gain_and_offset_change_nothing():
    left, right, _ = textured_pair(120, 80)
    dim = (left // 4 * 4) // 2 + 20
    plain, dimmed = (match(p, right, disparities=(0, 40)) for p in (left // 4 * 4, dim))
    both = np.isfinite(plain.values) & np.isfinite(dimmed.values)
    assert both.mean() > 0.85
    assert np.median(np.abs(plain.values - dimmed.values)[both]) < 1e-3


def test_16_bit_grey_and_colour_pictures_match_alike():
    left, right, _ = textured_pair(120, 80)
    eight = match(left, right, disparities=(0, 40))
    deep = match(left.astype(np.uint16) * 16, right.astype(np.uint16) * 16, disparities=(0, 40))
    colour = match(np.repeat(left[..., None], 3, 2), np.repeat(right[..., None], 3, 2), disparities=(0, 40))
    np.testing.assert_array_equal(eight.values, colour.values)
    both = np.isfinite(eight.values) & np.isfinite(deep.values)
    assert both.mean() > 0.85
    assert np.median(np.abs(eight.values - deep.values)[both]) < 0.05


@pytest.mark.parametrize("profile", ["paper", "fast", "precise"])
def test_flat_pictures_give_no_disparity(profile):
    left, right = (np.full((80, 120), 120, np.uint8) for _ in range(2))
    found = match(left, right, disparities=(0, 40), profile=profile)
    assert np.isnan(found.values).all()
    assert (found.validity == Validity.TEXTURELESS).all()


@pytest.mark.parametrize("grain", [1, 4])
def test_noise_gives_no_surface(grain):
    """Smooth paths make a surface of anything; it must not be believed where no window correlates."""
    rng = np.random.default_rng(8)
    left, right = (np.asarray(120 + rng.integers(0, grain + 1, (240, 320)), np.uint8) for _ in range(2))
    for profile in ("fast", "precise"):
        assert np.isfinite(match(left, right, disparities=(0, 64), profile=profile).values).mean() < 0.02


def test_threads_do_not_disturb_each_other(backend):
    """Two threads share a device and its scratch; every map is the one that a single thread gets."""
    pairs = [textured_pair(160, 120, seed)[:2] for seed in range(2)]

    def run(pair):
        return match(*pair, disparities=(0, 32), backend=backend.name).values

    alone = [run(pair) for pair in pairs]
    with ThreadPoolExecutor(2) as pool:
        for number, values in enumerate(pool.map(run, pairs * 5)):
            np.testing.assert_array_equal(values, alone[number % 2])


@pytest.mark.parametrize("profile", list(PROFILES))
def test_mask_leaves_pixels_out(profile):
    left, right, _ = textured_pair(120, 80)
    mask = np.zeros((80, 120), np.uint8)
    mask[20:60, 40:100] = 1
    # What is flat takes planes, which go on beyond any mask.
    left[55:, 60:] = right[55:, 60:] = 128
    found = match(left, right, disparities=(0, 40), mask=mask, profile=str(profile))
    outside = mask == 0
    assert np.isnan(found.values[outside]).all()
    assert (found.validity[outside] == Validity.MASKED).all()
    assert np.isfinite(found.values[~outside]).mean() > 0.8
    assert (found.confidence[outside] == 0).all()


def test_validity_and_values_tell_the_same():
    left, right, _ = textured_pair(200, 150)
    found = match(left, right, disparities=(0, 40))
    has_value = (found.validity == 0) | ((found.validity & Validity.FILLED) != 0)
    np.testing.assert_array_equal(has_value, np.isfinite(found.values))
    assert found.confidence.min() >= 0 and found.confidence.max() <= 1


@pytest.mark.parametrize("shape", [(3, 3), (4, 300), (300, 4)])
def test_tiny_pictures(shape):
    rng = np.random.default_rng(1)
    left, right = (rng.integers(0, 256, shape, np.uint8) for _ in range(2))
    found = match(left, right, disparities=(-2, 5), window=31)
    assert found.values.shape == shape


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"disparities": (0, 0)}, "empty range"),
        ({"disparities": (5000, 10)}, "lies outside"),
        ({"disparities": (0, 100_000)}, "at most 8192"),
        ({"disparities": "wide"}, "auto"),
        ({"window": 8}, "odd"),
        ({"window": 33}, "3 to 31"),
        ({"profile": "slow"}, "paper, fast, precise"),
        ({"reference": "top"}, "left or right"),
        ({"mask": np.ones((3, 3), np.uint8)}, "mask"),
    ],
)
def test_wrong_options_get_one_line(options, said):
    left, right, _ = textured_pair(60, 40)
    with pytest.raises(InputError, match=said) as caught:
        match(left, right, **options)
    assert "\n" not in str(caught.value)


def test_wrong_pictures_get_one_line():
    left, right, _ = textured_pair(60, 40)
    for wrong in (right[:, :-1].copy(), right.astype(np.float32), right[:1, :1]):
        with pytest.raises(PictureError) as caught:
            match(left, wrong)
        assert "\n" not in str(caught.value)


def test_too_large_a_volume_is_refused_before_it_is_taken(monkeypatch):
    left, right, _ = textured_pair(60, 40)
    device = open_backend()
    monkeypatch.setattr(type(device), "available_bytes", lambda self: (300_000, 300_000))
    with pytest.raises(MemoryLimitError, match=r"needs [\d,]+ bytes.*300,000.*profile fast"):
        match(left, right, disparities=(0, 64), profile="paper")


def test_options_are_recorded():
    left, right, _ = textured_pair(60, 40)
    found = match(left, right, disparities=(0, 30), window=9)
    assert found.options == {
        "profile": "fast",
        **dataclasses.asdict(PROFILES[Profile.FAST]),
        "window": 9,
        "tiles": [1, 1],
    }
    assert found.backend == open_backend().name
    assert set(found.seconds) == {"norms", "correlation", "refinement"}
