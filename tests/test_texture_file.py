import cv2
import numpy as np
import pytest

from stereo_gpu.errors import InputError
from stereo_gpu.images import decode_image
from stereo_gpu.model_files.texture_file import TEXTURE_FORMATS, pack_texture


@pytest.fixture(scope="module")
def photo():
    """Something like a photograph: colours that change slowly, edges, and a little noise."""
    rng = np.random.default_rng(3)
    soft = cv2.resize(rng.integers(0, 256, (12, 16, 3)).astype(np.uint8), (160, 120), interpolation=cv2.INTER_CUBIC)
    soft[30:60, 40:90] = (230, 40, 30)
    return np.clip(soft + rng.normal(0, 3, soft.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(("form", "quality"), [("png", None), ("webp", 100)])
def test_without_loss(photo, form, quality):
    np.testing.assert_array_equal(decode_image(pack_texture(photo, form, quality), form), photo)


@pytest.mark.parametrize(("form", "opening", "least"), [("jpeg", b"\xff\xd8", 38), ("webp", b"RIFF", 33)])
def test_with_little_loss(photo, form, opening, least):
    packed = pack_texture(photo, form)
    assert packed.startswith(opening) and len(packed) < len(pack_texture(photo)) / 2
    assert cv2.PSNR(decode_image(packed, form), photo) > least
    assert len(pack_texture(photo, form, 50)) < len(packed)
    # A red edge is not blurred more in colour than in brightness: JPEG keeps both at one scale.
    if form == "jpeg":
        error = np.abs(decode_image(packed, form)[25:65, 35:95].astype(int) - photo[25:65, 35:95]).mean()
        assert error < 3


@pytest.mark.parametrize(
    ("form", "quality", "reason"),
    [
        ("gif", None, "texture format 'gif' is unknown: choose png, jpeg, webp"),
        ("png", 90, "without loss; leave it out"),
        ("jpeg", 0, "a whole number from 1 to 100"),
        ("webp", 101, "a whole number from 1 to 100"),
        ("webp", 9.5, "a whole number from 1 to 100"),
        ("jpeg", True, "a whole number from 1 to 100"),
    ],
)
def test_wrong_options(photo, form, quality, reason):
    with pytest.raises(InputError, match=reason):
        pack_texture(photo, form, quality)


@pytest.mark.parametrize("form", ["jpeg", "webp"])
def test_sides_that_a_format_cannot_hold(form):
    most = TEXTURE_FORMATS[form]
    fits = np.zeros((1, most, 3), np.uint8)
    assert decode_image(pack_texture(fits, form), form).shape == fits.shape
    with pytest.raises(InputError, match=f"ends at {most} px a side: choose png"):
        pack_texture(np.zeros((1, most + 1, 3), np.uint8), form)
