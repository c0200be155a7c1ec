"""Numbers and short texts of a MATLAB 5 file, read within bounds.

Not by SciPy, whose reader takes a variable's length and types from the file as they are: a damaged file makes it fall
over with a segmentation fault, and some bytes can ask it for gigabytes. The format is that of MathWorks' MAT-File
Format, chapter 1: a header of 128 bytes, then elements of a type, a length and content, each a matrix or a packed one.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.types import Doubles

HEADER = 128  # bytes
COMPRESSED, MATRIX, INT8, INT32, UINT32 = 15, 14, 1, 5, 6  # types of an element
NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
TEXTS = {2: "ascii", 4: "utf-16", 16: "utf-8", 17: "utf-16"}
KINDS = {1: "cell", 2: "struct", 3: "object", 4: "text", 5: "sparse matrix"}  # classes that are no numbers
NUMBER_CLASSES = range(6, 16)  # double, single, and integers
TEXT_CLASS = 4
COMPLEX = 0x800
LARGEST_VARIABLE = 65_536  # bytes; the largest of ours are 3 x 3 numbers
LARGEST_CONTENT = 32 * 2**20  # bytes of all small variables; a hundred views take about 1 MB


@dataclass(frozen=True)
class Variables:
    """Numbers and short texts of a file, by name; numbers have the shape that the file gives them."""

    numbers: dict[str, Doubles] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)


def is_mat(data: bytes) -> bool:
    """Whether this is a file of MATLAB's, of version 5 or of 7.3, which is HDF5."""
    return data[:6] == b"MATLAB" or data[:8] == b"\x89HDF\r\n\x1a\n"


def read_variables(data: bytes, numbers: Sequence[str], texts: Sequence[str]) -> Variables:
    """The variables of the given names, as far as the file has them.

    Raises:
        InputError: this is no MATLAB 5 file, is cut off or damaged, or a variable is of another kind.
    """
    if data[:10] == b"MATLAB 7.3" or data[:4] == b"\x89HDF":
        raise InputError("it is of MATLAB 7.3 (HDF5): save it again with save -v7")
    if len(data) < HEADER or data[:10] != b"MATLAB 5.0" or data[126:128] not in (b"IM", b"MI"):
        raise InputError("it is no MATLAB 5 file: save it again with save -v7")
    order = "<" if data[126:128] == b"IM" else ">"
    found = Variables()
    for body in _matrices(data, order):
        kind, flags, shape, name, part = _open(body, order)
        if name in found.numbers or name in found.texts:
            raise InputError(f"{name} stands twice: save the file again")
        if name in numbers:
            if kind not in NUMBER_CLASSES or flags & COMPLEX:
                told = "complex matrix" if kind in NUMBER_CLASSES else KINDS.get(kind, f"matrix of class {kind}")
                raise InputError(f"{name} is a {told}: it must be plain numbers")
            found.numbers[name] = _numbers(name, part, shape, order)
        elif name in texts and kind == TEXT_CLASS:
            found.texts[name] = _text(name, part, order)
    return found


def _matrices(data: bytes, order: str) -> Iterator[bytes]:
    """The content of every variable that is no larger than LARGEST_VARIABLE, unpacked."""
    place, total = HEADER, 0
    while place < len(data):
        if len(data) - place < 8:
            raise InputError("it is cut off: copy it again")
        kind, length = struct.unpack_from(f"{order}II", data, place)
        body = data[place + 8 : place + 8 + length]
        if len(body) < length:
            raise InputError("it is cut off: copy it again")
        place += 8 + length
        if kind == COMPRESSED:
            element = _unpack(body)
            if element is None:
                continue
            kind, length = struct.unpack_from(f"{order}II", element.ljust(8, b"\0"))
            body = element[8:]
        if kind != MATRIX or length != len(body):
            raise InputError(f"it is damaged: an element of type {kind} with {len(body)} bytes; copy it again")
        if length <= LARGEST_VARIABLE:
            total += length
            if total > LARGEST_CONTENT:
                raise InputError(f"it holds more than {LARGEST_CONTENT >> 20} MiB: is it a calibration?")
            yield body


def _unpack(body: bytes) -> bytes | None:
    """A packed element, or None where it is too large to be one of ours."""
    inflater = zlib.decompressobj()
    try:
        element = inflater.decompress(body, LARGEST_VARIABLE + 9)
    except zlib.error as error:
        raise InputError(f"it is damaged: {error!s:.60}; copy it again") from None
    if len(element) > LARGEST_VARIABLE + 8:
        return None
    if not inflater.eof:
        raise InputError("it is damaged or cut off: a variable ends early; copy it again")
    return element


def _open(body: bytes, order: str) -> tuple[int, int, tuple[int, ...], str, tuple[int, bytes]]:
    """Class, flags, shape and name of a variable, and the type and bytes of what follows them."""
    parts = _parts(body, order)
    found = [next(parts, (0, b"")) for _ in range(4)]
    (flags_type, flags), (shape_type, shape), (name_type, name), content = found
    if flags_type != UINT32 or len(flags) != 8 or shape_type != INT32 or len(shape) % 4 or name_type != INT8:
        raise InputError("it is damaged: a variable without flags, shape or name; copy it again")
    first = struct.unpack_from(f"{order}I", flags)[0]
    sides = tuple(int(side) for side in np.frombuffer(shape, f"{order}i4"))
    return first & 0xFF, first, sides, name.decode("ascii", "replace"), content


def _parts(body: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Types and contents of what a variable is made of; four bytes or fewer stand within the tag itself."""
    place = 0
    while place + 8 <= len(body):
        kind, length = struct.unpack_from(f"{order}II", body, place)
        if kind >> 16:
            kind, length, start, step = kind & 0xFFFF, kind >> 16, place + 4, 8
        else:
            start, step = place + 8, 8 + (length + 7) // 8 * 8
        if length > (4 if step == 8 and start == place + 4 else len(body) - start):
            raise InputError("it is damaged: a part is longer than its variable; copy it again")
        yield kind, body[start : start + length]
        place += step


def _numbers(name: str, part: tuple[int, bytes], shape: tuple[int, ...], order: str) -> Doubles:
    kind, data = part
    if kind not in NUMBERS:
        raise InputError(f"it is damaged: {name} holds values of type {kind}; copy it again")
    type_ = np.dtype(order + NUMBERS[kind])
    count = 1
    for side in shape:
        count *= max(side, 0)
    if len(data) != count * type_.itemsize or not count:
        raise InputError(f"{name} has {' x '.join(map(str, shape))!s:.40} numbers in {len(data)} bytes: copy it again")
    # MATLAB stores column by column.
    return np.frombuffer(data, type_).astype(np.float64).reshape(shape, order="F")


def _text(name: str, part: tuple[int, bytes], order: str) -> str:
    kind, data = part
    coding = TEXTS.get(kind, "ascii")
    try:
        return data.decode(f"{coding}-{'le' if order == '<' else 'be'}" if coding == "utf-16" else coding)
    except UnicodeDecodeError:
        raise InputError(f"{name} is no text: copy the file again") from None
