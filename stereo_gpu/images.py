"""Pictures in and out: read from files with suspicion, written whole."""

from __future__ import annotations

import logging
import os
import stat
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np

from stereo_gpu.errors import PictureError
from stereo_gpu.files import write_whole
from stereo_gpu.types import Bytes, Picture

PIXEL_LIMIT = 400_000_000  # larger is a broken header rather than a camera
BYTE_LIMIT = PIXEL_LIMIT * 6 + 2**20  # 16 bit, three channels, not compressed
SMALLEST_SIDE = 3  # px: the smallest window that can be matched
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
PICTURE_SUFFIXES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".ppm", ".pgm", ".webp"}

logger = logging.getLogger(__name__)


def read_image(path: str | os.PathLike[str]) -> Picture:
    """Read a picture as (H, W) or (H, W, 3) RGB, uint8 or uint16, whatever OpenCV can decode.

    Alpha is dropped and logged: what lies under it is what the camera saw. An EXIF orientation is ignored,
    since a calibration belongs to the pixels of the sensor; turning one picture but not another would
    silently break the rig.

    Raises:
        PictureError: the file is missing, a folder, empty, no picture, cut off, damaged, of another number
            type than uint8 or uint16, or too large.
    """
    path = Path(path)
    picture = decode_image(_read_bytes(path), str(path))
    _check_size(str(path), picture)
    return picture


def decode_image(data: bytes, name: str) -> Picture:
    """The picture that the bytes of a file hold, of any size; as `read_image` says.

    Raises:
        PictureError: as there, but for a size that is too small; the message opens with `name`.
    """
    flaw, size = _look(data)
    if size is not None and size[0] * size[1] > PIXEL_LIMIT:
        raise PictureError(
            f"{name} says it is {size[0]} x {size[1]} px, the limit is {PIXEL_LIMIT // 10**6} megapixels: scale it down"
        )
    decoded = None if flaw else _decode(data)
    if decoded is None:
        raise PictureError(f"{name} {flaw or 'cannot be decoded'}: copy it again or save it as PNG")
    if decoded.dtype not in (np.uint8, np.uint16):
        raise PictureError(f"{name} holds {decoded.dtype} numbers: save it with 8 or 16 bits")
    channels = 1 if decoded.ndim == 2 else decoded.shape[2]
    if channels == 4:
        logger.info("%s: alpha channel dropped", name)
    if channels in (3, 4):
        decoded = cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB if channels == 3 else cv2.COLOR_BGRA2RGB)
    elif channels != 1:
        raise PictureError(f"{name} has {channels} channels: save it as grey or RGB")
    picture: Picture = decoded
    return picture


def write_png(path: str | os.PathLike[str], picture: Picture) -> Path:
    """Write a picture, (H, W) or (H, W, 3) RGB, uint8 or uint16, as PNG, whole or not at all.

    Raises:
        PictureError: this is no picture.
        InputError: the file cannot be written.
    """
    check_picture(str(path), picture)
    stored = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    _, data = cv2.imencode(".png", stored)
    return write_whole(path, data.tobytes())


def check_picture(name: str, picture: Picture) -> None:
    """Make sure that `picture` is one: uint8 or uint16, (H, W) or (H, W, 3), of a size that can be worked on.

    Raises:
        PictureError: it is not; the message opens with `name`.
    """
    if not isinstance(picture, np.ndarray):
        raise PictureError(f"{name} is a {type(picture).__name__}: give a NumPy array, or a path to read_image")
    if picture.dtype not in (np.uint8, np.uint16):
        bad = picture.dtype.kind == "f" and not np.isfinite(picture).all()
        raise PictureError(
            f"{name} holds {picture.dtype} numbers{', some not finite' if bad else ''}: scale it to uint8 or uint16"
        )
    if not (picture.ndim == 2 or (picture.ndim == 3 and picture.shape[2] == 3)):
        raise PictureError(f"{name} has shape {picture.shape}: it must be (H, W) or (H, W, 3)")
    _check_size(name, picture)


def check_pair(left: Picture, right: Picture) -> None:
    """Make sure that two pictures can be the two views of a pair.

    Raises:
        PictureError: one is no picture, or they differ in size, channels or number type.
    """
    check_picture("left", left)
    check_picture("right", right)
    check_one_size(left.shape[1::-1], right.shape[1::-1])
    if left.ndim != right.ndim:
        raise PictureError(f"left is {_colour(left)}, right is {_colour(right)}: give both in grey or both in colour")
    if left.dtype != right.dtype:
        raise PictureError(f"left is {left.dtype}, right is {right.dtype}: give both with the same number of bits")


def check_one_size(left: tuple[int, ...], right: tuple[int, ...]) -> None:
    """Make sure that two pictures of these sizes, (width, height), can be the two views of a pair.

    Raises:
        PictureError: they differ.
    """
    if left != right:
        raise PictureError(
            f"left is {left[0]} x {left[1]} px, right is {right[0]} x {right[1]} px:"
            " give two pictures of one size, as the cameras took them"
        )


def grey(picture: Picture) -> Bytes:
    """(H, W) uint8 from any picture; 16 bits are stretched so that the bright end is 255."""
    flat = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    if flat.dtype == np.uint16:
        # Many cameras put 10 or 12 bits into 16: dividing by 256 would leave a nearly black picture.
        bright = float(np.percentile(flat[::4, ::4], 99.9))
        flat = cv2.convertScaleAbs(flat, alpha=255.0 / max(1.0, bright))
    result: Bytes = np.ascontiguousarray(flat)
    return result


def _check_size(name: str, picture: Picture) -> None:
    height, width = picture.shape[:2]
    if min(height, width) < SMALLEST_SIDE:
        raise PictureError(
            f"{name} is {width} x {height} px: a picture needs {SMALLEST_SIDE} px a side or more, give a whole one"
        )
    if height * width > PIXEL_LIMIT:
        raise PictureError(
            f"{name} is {width} x {height} px, the limit is {PIXEL_LIMIT // 10**6} megapixels: scale it down"
        )


def _colour(picture: Picture) -> str:
    return "grey" if picture.ndim == 2 else "in colour"


def _read_bytes(path: Path) -> bytes:
    try:
        mode = path.stat()
        if stat.S_ISDIR(mode.st_mode):
            raise PictureError(f"{path} is a folder: name a picture in it")
        if not stat.S_ISREG(mode.st_mode):
            raise PictureError(f"{path} is a device or pipe: give a picture file")
        if mode.st_size > BYTE_LIMIT:
            raise PictureError(f"{path} has {mode.st_size} bytes, the limit is {BYTE_LIMIT}: scale it down")
        data = path.read_bytes()
    except FileNotFoundError:
        raise PictureError(f"{path}: there is no such file; check the path") from None
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        reason = getattr(error, "strerror", None) or error
        raise PictureError(f"{path} cannot be read: {reason}; check the path and its permissions") from error
    if not data:
        raise PictureError(f"{path} is empty: copy it again")
    return data


def _decode(data: bytes) -> Picture | None:
    """What OpenCV makes of the bytes, without its own lines on stderr."""
    before = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        decoded: Picture | None = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        return None
    finally:
        cv2.utils.logging.setLogLevel(before)
    return decoded


def _look(data: bytes) -> tuple[str, tuple[int, int] | None]:
    """What is wrong with the bytes of a JPEG or PNG ("" if nothing), and width and height from its header.

    OpenCV before version 5 fills the missing part of a picture that is cut off with grey, and both write
    to stderr past any log level, so that damage is found here first. Other formats are left to the decoder.
    """
    try:
        if data.startswith(b"\xff\xd8"):
            return _look_jpeg(data)
        if data.startswith(PNG_SIGNATURE):
            return _look_png(data)
    except (struct.error, IndexError):
        return "is cut off", None
    return "", None


def _look_jpeg(data: bytes) -> tuple[str, tuple[int, int] | None]:
    size = None
    at = 2
    while True:
        if data[at] != 0xFF:
            return "is damaged (no JPEG marker where one must stand)", size
        marker = data[at + 1]
        if marker == 0xFF:  # padding
            at += 1
            continue
        length = struct.unpack_from(">H", data, at + 2)[0]
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):  # the frame header
            height, width = struct.unpack_from(">HH", data, at + 5)
            size = (width, height)
        at += 2 + length
        if marker == 0xDA:  # the pixels: an end marker must follow, not one of a thumbnail before them
            return ("" if data.find(b"\xff\xd9", at) >= 0 else "is cut off"), size


def _look_png(data: bytes) -> tuple[str, tuple[int, int] | None]:
    width, height = struct.unpack_from(">II", data, 16)
    at = len(PNG_SIGNATURE)
    while True:
        length, kind = struct.unpack_from(">I4s", data, at)
        (checksum,) = struct.unpack_from(">I", data, at + 8 + length)
        if zlib.crc32(memoryview(data)[at + 4 : at + 8 + length]) != checksum:
            return "is damaged (a PNG checksum is wrong)", (width, height)
        if kind == b"IEND":
            return "", (width, height)
        at += 12 + length
