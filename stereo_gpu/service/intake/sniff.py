"""Tell a picture's format and size from its first bytes; nothing is decoded, whatever the file claims to be.

The header readers are our own: a decoder that is opened to ask for the size may take memory by what the header says
(Pillow's for WebP does), and it is the header that cannot be trusted.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO, NamedTuple

from stereo_gpu.errors import PictureError
from stereo_gpu.images import PNG_SIGNATURE, SMALLEST_SIDE
from stereo_gpu.service.settings import Settings

SUFFIXES = {"png": ".png", "jpeg": ".jpg", "webp": ".webp", "tiff": ".tif", "bmp": ".bmp", "pnm": ".pnm"}
TAKEN = "PNG, JPEG, WebP, TIFF, BMP or PNM"
MOST_SEGMENTS = 10_000  # of a JPEG before its frame header; a camera writes some dozen
MOST_ENTRIES = 4096  # of a TIFF's directory
FRAME_HEADERS = set(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # of JPEG
PNM_HEADER = re.compile(rb"P[1-6](?:\s|#[^\n]*\n)+(\d{1,9})(?:\s|#[^\n]*\n)+(\d{1,9})\s")
LONGEST_PNM_HEADER = 4096  # bytes, comments included

Size = tuple[int, int]


class Look(NamedTuple):
    """What a file's header says."""

    format: str  # a key of SUFFIXES
    width: int
    height: int


def look(path: Path, settings: Settings, *, name: str = "") -> Look:
    """The format of a picture and its size in px, by its header.

    Args:
        path: of the file.
        settings: say how large a picture may be.
        name: how the messages call it; its file's name otherwise.

    Raises:
        PictureError: it is empty, of no format that is taken, cut off in its header, too small or too large.
        OSError: it cannot be read.
    """
    name = name or path.name
    with path.open("rb") as stream:
        begin = stream.read(16)
        if not begin:
            raise PictureError(f"{name} is empty: send it again")
        form, read = _reader(begin)
        if read is None:
            raise PictureError(f"{name} is no picture of a format that is taken: send {TAKEN}")
        stream.seek(0)
        try:
            width, height = read(stream)
        except (struct.error, EOFError, ValueError, OverflowError):
            raise PictureError(f"{name} is cut off or damaged ({form}): copy it again or save it as PNG") from None
    if min(width, height) < SMALLEST_SIDE:
        raise PictureError(
            f"{name} is {width} x {height} px: a picture needs {SMALLEST_SIDE} px a side or more, give a whole one"
        )
    if width * height > settings.megapixels * 1e6:
        raise PictureError(
            f"{name} says it is {width} x {height} px, the limit is {settings.megapixels:g} megapixels: scale it down"
        )
    return Look(form, width, height)


def _reader(begin: bytes) -> tuple[str, Callable[[BinaryIO], Size] | None]:
    if begin.startswith(PNG_SIGNATURE):
        return "png", _png
    if begin.startswith(b"\xff\xd8\xff"):
        return "jpeg", _jpeg
    if begin.startswith(b"RIFF") and begin[8:12] == b"WEBP":
        return "webp", _webp
    if begin.startswith((b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")):
        return "tiff", _tiff
    if begin.startswith(b"BM"):
        return "bmp", _bmp
    if re.match(rb"P[1-6][\s#]", begin):
        return "pnm", _pnm
    return "", None


def _png(stream: BinaryIO) -> Size:
    kind, width, height = struct.unpack(">12x4sII", stream.read(24))
    if kind != b"IHDR":
        raise ValueError
    return width, height


def _jpeg(stream: BinaryIO) -> Size:
    stream.seek(2)
    for _ in range(MOST_SEGMENTS):
        (mark,) = stream.read(1) or b"\0"
        if mark != 0xFF:
            raise ValueError
        while mark == 0xFF:  # any number of them may stand before the marker itself
            (mark,) = stream.read(1) or b"\0"
        (length,) = struct.unpack(">H", stream.read(2))
        if mark in FRAME_HEADERS:
            height, width = struct.unpack(">xHH", stream.read(5))
            return width, height
        if mark in (0, 0xD9, 0xDA) or length < 2:  # the pixels, or the end, and no size so far
            raise ValueError
        stream.seek(length - 2, 1)
    raise ValueError


def _webp(stream: BinaryIO) -> Size:
    head = stream.read(30)
    kind = head[12:16]
    if kind == b"VP8X":
        width, height = (int.from_bytes(head[at : at + 3].ljust(3, b"\xff"), "little") + 1 for at in (24, 27))
        return width, height
    if kind == b"VP8L":
        signature, bits = struct.unpack_from("<BI", head, 20)
        if signature != 0x2F:
            raise ValueError
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if kind == b"VP8 ":
        sync, width, height = struct.unpack_from("<3sHH", head, 23)
        if sync != b"\x9d\x01\x2a":
            raise ValueError
        return width & 0x3FFF, height & 0x3FFF
    raise ValueError


def _tiff(stream: BinaryIO) -> Size:
    head = stream.read(16)
    order = "<" if head[:1] == b"I" else ">"
    big = head[2:4] in (b"+\0", b"\0+")
    counting, entry, value = ("Q", "HHQ8s", 8) if big else ("H", "HHI4s", 4)
    (begin,) = struct.unpack_from(f"{order}Q" if big else f"{order}I", head, 8 if big else 4)
    if begin > stream.seek(0, 2):  # past the end, where some file systems do not even go
        raise EOFError
    stream.seek(begin)
    (count,) = struct.unpack(f"{order}{counting}", stream.read(struct.calcsize(f"={counting}")))
    if count > MOST_ENTRIES:
        raise ValueError
    found: dict[int, int] = {}
    for _ in range(count):
        tag, kind, many, held = struct.unpack(f"{order}{entry}", stream.read(12 if value == 4 else 20))
        if tag not in (256, 257):
            continue
        size = {3: 2, 4: 4, 16: 8}.get(kind)  # SHORT, LONG, LONG8
        if size is None or size > value or many != 1 or tag in found:  # twice: readers may take either
            raise ValueError
        found[tag] = int.from_bytes(held[:size], "little" if order == "<" else "big")
    if len(found) != 2:
        raise ValueError
    return found[256], found[257]


def _bmp(stream: BinaryIO) -> Size:
    stream.seek(14)
    (header,) = struct.unpack("<I", stream.read(4))
    width, height = struct.unpack("<HH" if header == 12 else "<ii", stream.read(4 if header == 12 else 8))
    return width, abs(height)  # below 0: from the top down


def _pnm(stream: BinaryIO) -> Size:
    found = PNM_HEADER.match(stream.read(LONGEST_PNM_HEADER))
    if found is None:
        raise ValueError
    return int(found[1]), int(found[2])
