"""Formats and sizes told from headers, before anything is decoded."""

import io
import random
import struct

import cv2
import numpy as np
import pytest
from PIL import Image

from stereo_gpu.errors import PictureError
from stereo_gpu.images import read_image
from stereo_gpu.service.intake.sniff import SUFFIXES, look
from stereo_gpu.service.settings import Settings

PICTURE = np.random.default_rng(7).integers(0, 256, (123, 457, 3), np.uint8)
WRITTEN = {
    "a.png": "png",
    "a.jpg": "jpeg",
    "a.webp": "webp",
    "a.tif": "tiff",
    "a.bmp": "bmp",
    "a.pnm": "pnm",
}
SAVED = {
    "webp": {"lossless": True},
    "webp with a profile": {"format": "webp", "icc_profile": b"p" * 200},
    "tiff": {"big_tiff": True},
    "jpeg": {"progressive": True, "comment": b"c" * 60_000},
}


@pytest.fixture
def settings(tmp_path):
    return Settings(data=tmp_path)


def write(folder, data, name="file"):
    path = folder / name
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("name", WRITTEN)
@pytest.mark.parametrize("kind", ["grey", "colour", "deep"])
def test_what_opencv_writes_is_told_as_it_is_read(name, kind, tmp_path, settings):
    picture = {"grey": PICTURE[..., 0], "colour": PICTURE, "deep": PICTURE.astype(np.uint16) * 257}[kind]
    if kind == "deep" and WRITTEN[name] in ("jpeg", "webp", "bmp"):
        picture = PICTURE[::2, ::3]
    assert cv2.imwrite(str(tmp_path / name), picture)
    height, width = read_image(tmp_path / name).shape[:2]
    assert look(tmp_path / name, settings) == (WRITTEN[name], width, height)
    assert WRITTEN[name] in SUFFIXES


@pytest.mark.parametrize("name", SAVED)
def test_other_ways_to_write_them(name, tmp_path, settings):
    options = {"format": name, **SAVED[name]}
    Image.fromarray(PICTURE).save(tmp_path / "file", **options)
    assert look(tmp_path / "file", settings) == (options["format"], 457, 123)


def test_pnm_with_comments(tmp_path, settings):
    assert look(write(tmp_path, b"P5 # made by hand\n# twice\n 20\n30 255\n" + bytes(600)), settings) == ("pnm", 20, 30)
    assert look(write(tmp_path, b"P2\n4 3\n255\n" + b"1 " * 12), settings) == ("pnm", 4, 3)


@pytest.mark.parametrize(
    "data",
    [
        b"GIF89a" + bytes(40),
        b"<svg xmlns='http://www.w3.org/2000/svg' width='9' height='9'/>",
        b"%PDF-1.7\n",
        b"PK\x03\x04" + bytes(40),
        b"\x80\x04\x95" + bytes(40),  # a pickle
        b"\x93NUMPY\x01\0",
        bytes(12) + b"ftypheic",
        b"\0\0\0\x0cJXL \r\n\x87\n",
        b"v/1\x01" + bytes(40),  # OpenEXR
        b"P7\nWIDTH 9\nHEIGHT 9\n",
        b"hello",
        b"\0",
    ],
)
def test_anything_else_is_refused_by_content(data, tmp_path, settings):
    with pytest.raises(PictureError, match=r"^left \(a\.png\) is no picture of a format that is taken: send PNG"):
        look(write(tmp_path, data, "a.png"), settings, name="left (a.png)")


def test_an_empty_file_is_named(tmp_path, settings):
    with pytest.raises(PictureError, match="is empty: send it again"):
        look(write(tmp_path, b""), settings)


def png(width, height):
    return b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0) + bytes(4)


def webp(width, height):
    sides = (width - 1).to_bytes(3, "little") + (height - 1).to_bytes(3, "little")
    return b"RIFF\xff\0\0\0WEBPVP8X\x0a\0\0\0" + bytes(4) + sides


@pytest.mark.parametrize(
    "bomb",
    [
        png(60_000, 60_000),
        png(2**31 - 1, 2**31 - 1),
        webp(16_383, 16_383),
        webp(2**24, 2**24),
        b"P6 999999999 999999999 255\n",
        b"BM" + bytes(12) + struct.pack("<Iii", 40, 100_000, -100_000),
        b"\xff\xd8\xff\xc0\0\x11\x08" + struct.pack(">HH", 65_535, 65_535) + bytes(12),
        b"II*\0\x08\0\0\0\2\0"
        + struct.pack("<HHII", 256, 4, 1, 2**32 - 1)
        + struct.pack("<HHII", 257, 4, 1, 2**32 - 1),
        b"II+\0\x08\0\0\0\x10\0\0\0\0\0\0\0\2\0\0\0\0\0\0\0"
        + struct.pack("<HHQQ", 256, 16, 1, 2**63)
        + struct.pack("<HHQQ", 257, 16, 1, 2**63),
    ],
)
def test_bombs_are_refused_by_their_headers(bomb, tmp_path, settings):
    with pytest.raises(PictureError, match=r"says it is \d+ x \d+ px, the limit is 50 megapixels: scale it down"):
        look(write(tmp_path, bomb), settings)


def test_the_limit_is_a_setting(tmp_path):
    path = write(tmp_path, png(1000, 1000))
    assert look(path, Settings(data=tmp_path, megapixels=1.0)) == ("png", 1000, 1000)
    with pytest.raises(PictureError, match=r"1000 x 1000 px, the limit is 0\.9 megapixels"):
        look(path, Settings(data=tmp_path, megapixels=0.9))
    with pytest.raises(PictureError, match="is 2 x 1000 px: a picture needs 3 px a side"):
        look(write(tmp_path, png(2, 1000)), Settings(data=tmp_path))


@pytest.mark.parametrize(
    "data",
    [
        b"\xff\xd8\xff" + b"\xff" * 50_000,  # nothing but padding
        b"\xff\xd8" + b"\xff\xe0\0\2" * 20_000,  # segments without end
        b"\xff\xd8\xff\xe0\0\0",  # a segment shorter than its own length
        b"\xff\xd8\xff\xda\0\2",  # pixels before a size
        b"II*\0\xff\xff\xff\xff",  # a directory beyond the end
        b"MM\0+\0\x08\0\0" + b"\x7f\xff\xff\xff" * 2,
        b"II*\0\x08\0\0\0\xff\xff" + bytes(100_000),  # 65,535 entries
        b"II*\0\x08\0\0\0\2\0" + struct.pack("<HHII", 256, 3, 1, 9) * 2,  # one side twice
        b"II*\0\x08\0\0\0\1\0" + struct.pack("<HHII", 256, 3, 9, 9),  # a side of nine numbers
        b"RIFF\0\0\0\0WEBPVP8 " + bytes(30),
        b"RIFF\0\0\0\0WEBPnone" + bytes(30),
        b"P6\n" + b"#" * 10_000,
        b"P6 -5 7 255\n",
        b"BM",
        png(9, 9)[:20],
    ],
)
def test_broken_headers_are_refused_in_a_line(data, tmp_path, settings):
    with pytest.raises(PictureError, match=r"^file is cut off or damaged \(\w+\): copy it again or save it as PNG$"):
        look(write(tmp_path, data), settings)


@pytest.mark.parametrize("form", ["png", "jpeg", "webp", "tiff", "bmp", "ppm"])
def test_what_is_told_of_damaged_files_is_what_they_decode_to(form, tmp_path, settings):
    held = io.BytesIO()
    Image.fromarray(PICTURE[:40, :50]).save(held, format=form)
    whole = held.getvalue()
    chance = random.Random(form)
    said = set()
    for _ in range(100):
        data = bytearray(whole[: chance.choice((chance.randrange(1, 64), len(whole), len(whole)))])
        for _ in range(chance.randrange(4)):
            data[chance.randrange(min(len(data), 150))] = chance.choice((0, 1, 2, 255, chance.randrange(256)))
        path = write(tmp_path, data)
        try:
            _, width, height = look(path, settings)
        except PictureError as error:
            assert "\n" not in str(error)
            assert len(str(error)) < 200
            said.add("refused")
            continue
        assert 0 < width * height <= settings.megapixels * 1e6
        try:
            assert read_image(path).shape[:2] == (height, width)
            said.add("decoded")
        except PictureError:
            said.add("broken within")
    assert said >= {"refused", "decoded"}
