"""Window "auto": a window for each pixel beats every window for all, and invents nothing."""

import cv2
import numpy as np
import pytest

from stereo_gpu.config import AUTO_WINDOWS
from stereo_gpu.errors import InputError
from stereo_gpu.images import read_image
from stereo_gpu.match import match
from stereo_gpu.pipeline import reconstruct_rectified
from stereo_gpu.types import RectifiedPair, Validity

SINGLE = (3, 5, 7, 11, 15)


def scales_pair(width=400, height=240, seed=3):
    """Texture that coarsens from left to right, boxes before a wall that leans, and noise.

    Returns the pair, the disparity on the left view, and whether the right view sees it.
    """
    rng = np.random.default_rng(seed)

    def textures():
        out = np.zeros((height, width + 40), np.float32)
        for band, sigma in enumerate((0.8, 1.6, 3.2, 6.4, 12.8)):
            noise = cv2.GaussianBlur(rng.normal(size=out.shape), (0, 0), sigma, borderType=cv2.BORDER_REFLECT)
            columns = slice(band * width // 5, (band + 1) * width // 5 + 40 * (band == 4))
            out[:, columns] = 128 + 35 * noise[:, columns] / noise.std()
        return out

    wall, near = textures(), textures()
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    lean = (8 + 3 * y / (height - 1)).astype(np.float32)
    box = np.zeros((height, width), np.float32)
    for band in range(5):
        for top, side in ((30, 44), (100, 30), (170, 18)):
            left = band * width // 5 + 18
            box[top : top + side, left : left + side] = 1
    behind = cv2.remap(wall, x + lean, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    before = cv2.remap(near, x + 18, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    box_right = cv2.remap(box, x + 18, y, cv2.INTER_NEAREST)
    truth = np.where(box > 0, 18, lean)
    partner = np.round(x - truth).astype(int)
    hidden = (box == 0) & (np.take_along_axis(box_right, np.maximum(partner, 0), 1) > 0)
    pictures = np.where(box > 0, near[:, :width], wall[:, :width]), np.where(box_right > 0, before, behind)
    noisy = (np.clip(np.round(p + rng.normal(0, 1.5, p.shape)), 0, 255).astype(np.uint8) for p in pictures)
    return *noisy, truth, (partner >= 0) & ~hidden


def bad(left, right, truth, counted, disparities, window):
    found = match(left, right, disparities=(0, disparities), reference="left", profile="fast", window=window)
    return 100 * (~(np.abs(found.values - truth) <= 1))[counted].mean()


def test_auto_beats_every_window_where_texture_has_many_scales():
    left, right, truth, counted = scales_pair()
    auto = bad(left, right, truth, counted, 32, "auto")
    singles = [bad(left, right, truth, counted, 32, window) for window in SINGLE]
    assert auto < min(singles) - 0.5  # measured: 8.0 against 8.9 to 18.5


def test_auto_beats_every_window_on_real_pairs(data):
    scores = {window: [] for window in ("auto", *SINGLE)}
    for folder, names, scale, disparities in (
        ("teddy", ("im2.png", "im6.png"), 4, 64),
        ("tsukuba", ("im3.png", "im4.png"), 16, 16),
        ("aloe_light", ("left.png", "right.png"), 256, 80),
        ("aloe_light", ("left.png", "right_light.png"), 256, 80),
    ):
        left, right = (read_image(data / "stereo" / folder / name) for name in names)
        truth = cv2.imread(str(data / "stereo" / folder / "groundtruth.png"), cv2.IMREAD_ANYDEPTH) / scale
        counted = truth > 0
        if (data / "stereo" / folder / "nonocc.png").is_file():
            counted &= cv2.imread(str(data / "stereo" / folder / "nonocc.png"), cv2.IMREAD_GRAYSCALE) == 255
        for window, found in scores.items():
            found.append(bad(left, right, truth, counted, disparities, window))
    auto, singles = np.array(scores.pop("auto")), np.array(list(scores.values()))
    assert auto.mean() < singles.mean(axis=1).min()
    assert (auto <= singles.min(axis=0) + 0.3).all(), (auto, singles)


@pytest.mark.parametrize("grain", [1, 4, 200])
def test_auto_finds_no_surface_in_noise(grain):
    rng = np.random.default_rng(8)
    left, right = (np.asarray(20 + rng.integers(0, grain + 1, (240, 320)), np.uint8) for _ in range(2))
    found = match(left, right, disparities=(0, 64), profile="fast", window="auto")
    assert np.isfinite(found.values).mean() < 0.02


@pytest.mark.parametrize("device", ["opencl", "warp:cpu"])
def test_auto_says_what_it_did(device):
    left, right, truth, counted = scales_pair(200, 120)
    mask = np.ones(left.shape, np.uint8)
    mask[:, :20] = 0
    found = match(
        left, right, disparities=(0, 32), reference="left", profile="fast", window="auto", mask=mask, backend=device
    )
    assert found.options["windows"] == AUTO_WINDOWS
    given = np.isfinite(found.values)
    assert (np.abs(found.values - truth)[given & counted] < 1).mean() > 0.85
    # A value has no reason to be missing, and what is missing has one.
    np.testing.assert_array_equal(given, (found.validity == 0) | ((found.validity & Validity.FILLED) != 0))
    assert (found.validity[:, :20] == Validity.MASKED).all()
    assert ((found.confidence > 0) <= given).all() and found.confidence.max() > 0.9
    # The same with pictures and result mirrored.
    turned = match(
        right[:, ::-1].copy(),
        left[:, ::-1].copy(),
        disparities=(0, 32),
        reference="right",
        profile="fast",
        window="auto",
        mask=mask[:, ::-1].copy(),
        backend=device,
    )
    np.testing.assert_array_equal(found.values, turned.values[:, ::-1])
    np.testing.assert_array_equal(found.validity, turned.validity[:, ::-1])


def test_auto_in_tiles_is_the_same():
    left, right, _, _ = scales_pair()
    whole, tiled = (
        match(left, right, disparities=(0, 32), profile="fast", window="auto", tile=tile) for tile in (None, 128)
    )
    np.testing.assert_array_equal(whole.values, tiled.values)
    np.testing.assert_array_equal(whole.validity, tiled.validity)


def test_reconstruction_takes_auto():
    left, right, _, _ = scales_pair(200, 120)
    pair = RectifiedPair.from_geometry(left, right, focal_px=200, baseline=50, cx_left=100, cx_right=100, cy=60)
    result = reconstruct_rectified(pair, profile="fast", window="auto", disparities=(0, 32))
    assert result.disparity.options["windows"] == AUTO_WINDOWS
    assert len(result.mesh.faces) > 1000


def test_precise_takes_auto_as_its_own_choice():
    left, right, _, _ = scales_pair(120, 80)
    chosen, plain = (
        match(left, right, disparities=(0, 24), profile="precise", window=window) for window in ("auto", None)
    )
    np.testing.assert_array_equal(chosen.values, plain.values)


@pytest.mark.parametrize(
    ("profile", "window", "message"),
    [
        ("paper", "auto", "window = auto: profile paper has one window"),
        ("fast", "automatic", "window = 'automatic': give the side of a square in px, odd, 3 to 31, or auto"),
        ("fast", 4, "window = 4: it must be odd and from 3 to 31, or auto"),
        ("precise", 33, "window = 33"),
    ],
)
def test_wrong_windows_are_refused_in_a_line(profile, window, message):
    picture = np.zeros((40, 60), np.uint8)
    with pytest.raises(InputError, match=message) as caught:
        match(picture, picture, profile=profile, window=window)
    assert "\n" not in str(caught.value)
