import logging
import struct
import zlib

import cv2
import numpy as np
import pytest

from stereo_gpu.errors import InputError, PictureError
from stereo_gpu.images import check_pair, check_picture, grey, read_image, write_png


def picture(shape=(37, 51, 3), dtype=np.uint8):
    random = np.random.default_rng(1)
    return random.integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)


@pytest.mark.parametrize("shape", [(37, 51), (37, 51, 3)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_png_round_trip(tmp_path, shape, dtype):
    original = picture(shape, dtype)
    back = read_image(write_png(tmp_path / "a.png", original))
    assert back.dtype == dtype
    np.testing.assert_array_equal(back, original)


def test_colours_come_as_rgb(tmp_path):
    red = np.zeros((5, 5, 3), np.uint8)
    red[..., 2] = 255  # OpenCV writes BGR
    cv2.imwrite(str(tmp_path / "red.png"), red)
    assert read_image(tmp_path / "red.png")[2, 2].tolist() == [255, 0, 0]


def test_alpha_is_dropped_and_logged(tmp_path, caplog):
    bgra = picture((9, 9, 4))
    cv2.imwrite(str(tmp_path / "a.png"), bgra)
    with caplog.at_level(logging.INFO):
        back = read_image(tmp_path / "a.png")
    np.testing.assert_array_equal(back, bgra[..., 2::-1])
    assert "alpha" in caplog.text


def test_the_exif_orientation_is_ignored(tmp_path):
    _, data = cv2.imencode(".jpg", np.zeros((20, 30, 3), np.uint8))
    turned = struct.pack("<2sHIHHHIHHI", b"II", 42, 8, 1, 0x0112, 3, 1, 6, 0, 0)
    exif = b"Exif\x00\x00" + turned
    segment = b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif
    (tmp_path / "a.jpg").write_bytes(data.tobytes()[:2] + segment + data.tobytes()[2:])
    assert read_image(tmp_path / "a.jpg").shape == (20, 30, 3)


def test_a_very_wide_picture(tmp_path):
    wide = picture((3, 20_000))
    assert read_image(write_png(tmp_path / "wide.png", wide)).shape == (3, 20_000)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tiff", ".bmp", ".ppm", ".pgm", ".webp"])
def test_a_picture_cut_off_anywhere_is_refused_quietly(tmp_path, suffix, capfd):
    flat = cv2.GaussianBlur(picture((60, 80) if suffix == ".pgm" else (60, 80, 3)), (5, 5), 0)
    data = cv2.imencode(suffix, flat)[1].tobytes()
    path = tmp_path / f"cut{suffix}"
    path.write_bytes(data)
    assert read_image(path).shape == flat.shape
    for share in (0.0, 0.01, 0.1, 0.5, 0.9, 0.99):
        path.write_bytes(data[: int(len(data) * share)])
        with pytest.raises(PictureError, match="cut") as caught:
            read_image(path)
        assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_a_jpeg_cut_off_after_its_thumbnail_is_refused(tmp_path):
    _, data = cv2.imencode(".jpg", picture((60, 80, 3)))
    thumbnail = cv2.imencode(".jpg", np.zeros((8, 8), np.uint8))[1].tobytes()
    segment = b"\xff\xe1" + struct.pack(">H", len(thumbnail) + 2) + thumbnail  # has an end marker of its own
    whole = data.tobytes()[:2] + segment + data.tobytes()[2:]
    (tmp_path / "a.jpg").write_bytes(whole)
    assert read_image(tmp_path / "a.jpg").shape == (60, 80, 3)
    (tmp_path / "a.jpg").write_bytes(whole[: len(whole) * 3 // 4])
    with pytest.raises(PictureError, match="is cut off"):
        read_image(tmp_path / "a.jpg")


def test_a_flipped_bit_in_a_png_is_refused_quietly(tmp_path, capfd):
    path = write_png(tmp_path / "a.png", picture())
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 4
    path.write_bytes(data)
    with pytest.raises(PictureError, match="checksum"):
        read_image(path)
    assert capfd.readouterr() == ("", "")


def test_a_header_that_promises_too_much_is_refused_before_memory_is_taken(tmp_path):
    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0))
    (tmp_path / "bomb.png").write_bytes(b"\x89PNG\r\n\x1a\n" + header + chunk(b"IEND", b""))
    with pytest.raises(PictureError, match="60000 x 60000 px, the limit is 400 megapixels"):
        read_image(tmp_path / "bomb.png")


def test_files_that_are_no_pictures(tmp_path):
    for name, content, told in (
        ("empty.png", b"", "is empty"),
        ("text.png", b"not a picture", "cannot be decoded"),
        ("noise.jpg", b"\xff\xd8" + bytes(100), "is damaged"),
        ("short.jpg", b"\xff\xd8\xff", "is cut off"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(PictureError, match=told):
            read_image(tmp_path / name)
    for path, told in ((tmp_path / "none.png", "no such file"), (tmp_path, "is a folder"), ("/dev/zero", "device")):
        with pytest.raises(PictureError, match=told):
            read_image(path)


def test_floats_and_single_pixels_in_a_file_are_refused(tmp_path):
    cv2.imwrite(str(tmp_path / "float.tiff"), np.zeros((9, 9), np.float32))
    with pytest.raises(PictureError, match="holds float32"):
        read_image(tmp_path / "float.tiff")
    cv2.imwrite(str(tmp_path / "one.png"), np.zeros((1, 1), np.uint8))
    with pytest.raises(PictureError, match=r"one\.png is 1 x 1 px"):
        read_image(tmp_path / "one.png")


def test_write_png_refuses_what_is_no_picture(tmp_path):
    with pytest.raises(PictureError, match="float64"):
        write_png(tmp_path / "a.png", np.zeros((5, 5)))
    with pytest.raises(InputError, match="no folder"):
        write_png(tmp_path / "none" / "a.png", picture())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("left", "right", "told"),
    [
        (picture(), picture((37, 52, 3)), "left is 51 x 37 px, right is 52 x 37 px"),
        (picture(), picture((37, 51)), "left is in colour, right is grey"),
        (picture(), picture(dtype=np.uint16), "left is uint8, right is uint16"),
        (np.full((9, 9), np.nan), picture((9, 9)), "left holds float64 numbers, some not finite"),
        (picture((9, 9)), np.zeros((9, 9), np.float32), "right holds float32"),
        (picture((9, 9, 4)), picture((9, 9)), r"left has shape \(9, 9, 4\)"),
        (picture((1, 1)), picture((1, 1)), "left is 1 x 1 px"),
        (picture((9, 2)), picture((9, 2)), "left is 2 x 9 px"),
        ("a.png", picture(), "left is a str"),
        (np.broadcast_to(np.uint8(0), (30_000, 30_000)), picture(), "the limit is 400 megapixels"),
    ],
)
def test_pairs_that_are_none(left, right, told):
    with pytest.raises(PictureError, match=told):
        check_pair(left, right)


def test_pairs_that_are_fine():
    check_pair(picture(), picture())
    check_pair(picture((3, 3), np.uint16), picture((3, 3), np.uint16))
    check_picture("wide", np.broadcast_to(np.uint8(0), (15_000, 20_000)))


def test_grey_stretches_the_bits_that_a_camera_fills():
    ramp = np.random.default_rng(0).permutation(np.linspace(0, 4095, 100 * 100)).astype(np.uint16)
    ramp = ramp.reshape(100, 100)
    flat = grey(ramp)
    assert flat.dtype == np.uint8
    np.testing.assert_allclose(flat, ramp / 4095 * 255, atol=1)
    assert grey(np.full((4, 4, 3), 90, np.uint8)).tolist() == [[90] * 4] * 4
