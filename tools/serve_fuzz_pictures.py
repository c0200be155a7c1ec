"""Pictures that no camera took: damaged, mislabelled, and such as would fill the memory if they were believed."""

import random
import struct
import zlib

import cv2
import numpy as np

SIZE = (320, 240)  # of the rig's pictures: what has another size never comes to a worker


def seeds(left: bytes) -> dict[str, bytes]:
    """The same picture in all formats that are taken."""
    picture = cv2.imdecode(np.frombuffer(left, np.uint8), cv2.IMREAD_UNCHANGED)
    coded = {name: cv2.imencode(f".{name}", picture)[1].tobytes() for name in ("jpg", "webp", "tif", "bmp", "ppm")}
    return {"png": left, **coded}


def bombs() -> dict[str, bytes]:
    """Small files that claim, or hold packed, what is huge."""
    width, height = SIZE
    row = bytes(1 + 3 * width)
    return {
        "png of 3.6 gigapixels": png(60_000, 60_000, zlib.compress(bytes(1000))),
        "png with the largest sides": png(2**31 - 1, 2**31 - 1, b""),
        "png with 200 MB behind 320 x 240": png(width, height, zlib.compress(row * height + bytes(200 << 20), 9)),
        "png with text of 100 MB": png(
            width, height, zlib.compress(row * height), (b"zTXt", b"a\0\0" + zlib.compress(bytes(100 << 20), 9))
        ),
        "png with a profile of 100 MB": png(
            width, height, zlib.compress(row * height), (b"iCCP", b"a\0\0" + zlib.compress(bytes(100 << 20), 9))
        ),
        "png of 3.9 megapixels of nothing": png(1990, 1990, zlib.compress(bytes((1 + 3 * 1990) * 1990), 9)),
        "webp of 268 megapixels": b"RIFF\xff\0\0\0WEBPVP8X\x0a\0\0\0\x02\0\0\0" + b"\xfe\x3f\0" * 2 + bytes(200),
        "jpeg of 4.3 gigapixels": b"\xff\xd8\xff\xc0\0\x11\x08\xff\xff\xff\xff\3\1\x11\0\2\x11\1\3\x11\1" + bytes(99),
        "tiff of 18 exapixels": tiff(2**32 - 1, 2**32 - 1, 1),
        "tiff with strips of 4 GB": tiff(width, height, 2**32 - 1),
        "bmp of 10 gigapixels": b"BM"
        + bytes(8)
        + b"\x36\0\0\0"
        + struct.pack("<IiiHHI", 40, 100_000, 100_000, 1, 24, 0),
        "bmp with rows upside down and runs": b"BM"
        + bytes(8)
        + struct.pack("<IIiiHHIIiiII", 54, 40, width, -height, 1, 8, 1, 0, 0, 0, 0, 0)
        + b"\xff\1" * 500,
        "ppm of 10^18 pixels": b"P6 999999999 999999999 255\n",
        "ppm with a word without end": b"P6 320 240 " + b"9" * 100_000,
    }


def others() -> dict[str, bytes]:
    """What is no picture that is taken."""
    return {
        "nothing": b"",
        "gif": b"GIF89a\x40\1\xf0\0\0\0\0,\0\0\0\0\x40\1\xf0\0\0\2\0;",
        "svg": b"<svg xmlns='http://www.w3.org/2000/svg'><image href='file:///etc/passwd'/></svg>",
        "pickle": b"\x80\x04\x95\x1f\0\0\0\0\0\0\0\x8c\5posix\x94\x8c\6system\x94\x93\x94\x8c\2id\x94\x85\x94R\x94.",
        "numpy": b"\x93NUMPY\1\0v\0{'descr': '|O', 'fortran_order': False, 'shape': (1,), }" + bytes(60),
        "zip": b"PK\3\4" + bytes(60),
        "program": b"\x7fELF" + bytes(60),
        "script": b"#!/bin/sh\nrm -rf /\n",
        "html": b"<html><script>alert(1)</script>",
        "heic": bytes(4) + b"ftypheic" + bytes(60),
        "exr": b"v/1\1" + bytes(60),
        "hdr": b"#?RADIANCE\n\n-Y 99999 +X 99999\n",
        "pfm": b"PF\n99999 99999\n-1\n",
        "pam": b"P7\nWIDTH 99999\nHEIGHT 99999\nDEPTH 4\nMAXVAL 255\nENDHDR\n",
        "jpeg 2000": b"\0\0\0\x0cjP  \r\n\x87\n" + bytes(60),
        "address": b"http://169.254.169.254/latest/meta-data/",
        "zeros": bytes(5000),
    }


def png(width: int, height: int, packed: bytes, *more: tuple[bytes, bytes]) -> bytes:
    """A PNG in colour, of chunks whose checksums are right."""
    chunks = (
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)),
        *more,
        (b"IDAT", packed),
        (b"IEND", b""),
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )


def tiff(width: int, height: int, strip: int) -> bytes:
    """A TIFF whose one strip says that it has so many bytes."""
    entries = (
        (256, width),
        (257, height),
        (258, 8),
        (259, 8),
        (262, 1),
        (273, 8),
        (277, 1),
        (278, height),
        (279, strip),
    )
    packed = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in entries)
    return b"II*\0\x08\0\0\0" + struct.pack("<H", len(entries)) + packed + bytes(64)


def damage(chance: random.Random, data: bytes) -> bytes:
    """Bytes changed, cut, doubled or moved; often near the beginning, where headers are."""
    held = bytearray(data)
    for _ in range(chance.choice((1, 1, 2, 5, 40))):
        if not held:
            break
        at = chance.randrange(min(len(held), chance.choice((64, 400, len(held)))))
        way = chance.randrange(6)
        if way == 0:
            held[at] ^= 1 << chance.randrange(8)
        elif way == 1:
            held[at] = chance.choice((0, 1, 127, 128, 255))
        elif way == 2:
            held[at : at + 4] = chance.choice((b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", bytes(4), b"\0\0\0\1"))
        elif way == 3:
            del held[at : at + chance.choice((1, 2, 16, 1000))]
        elif way == 4:
            held[at:at] = held[at : at + chance.choice((1, 8, 500))]
        else:
            del held[chance.randrange(len(held)) :]
    return bytes(held)
