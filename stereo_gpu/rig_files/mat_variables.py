"""Small variables of a MATLAB 5 file, read by SciPy once they are inflated within bounds.

SciPy takes a variable's length from the file before it looks at what is there, so that a few bytes can ask for
gigabytes. Here each variable is inflated up to a limit first, and those that are larger than a calibration's numbers
can be are left out; SciPy gets the rest, of which it reads the wanted names of plain classes only.
"""

from __future__ import annotations

import io
import struct
import warnings
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.types import Doubles

HEADER = 128  # bytes
COMPRESSED, MATRIX = 15, 14  # types of an element
LARGEST_VARIABLE = 65_536  # bytes; the largest of ours are 3 x 3 numbers
LARGEST_CONTENT = 32 * 2**20  # bytes of all small variables; a hundred views take about 1 MB
LONGEST_TEXT = 16
NUMBERS = {"double", "single", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64"}


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
    from scipy.io import loadmat, whosmat

    if data[:10] == b"MATLAB 7.3" or data[:4] == b"\x89HDF":
        raise InputError("it is of MATLAB 7.3 (HDF5): save it again with save -v7")
    plain = io.BytesIO(_inflate(data))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # SciPy warns of what is checked here
            listed = whosmat(plain)
            wanted = _choose(listed, numbers, texts)
            plain.seek(0)
            found = loadmat(plain, variable_names=wanted, chars_as_strings=True) if wanted else {}
    except InputError:
        raise
    except Exception as error:  # SciPy names no set of errors for a damaged file
        told = " ".join(str(error).split())
        raise InputError(f"it is damaged: {told or type(error).__name__:.80}; copy it again") from None
    result = Variables()
    for name in wanted:
        value = np.asarray(found.get(name))
        if name in texts and value.dtype.kind == "U" and value.size == 1:
            result.texts[name] = str(value.reshape(-1)[0])
        elif name in numbers and value.dtype.kind in "fiu":
            result.numbers[name] = value.astype(np.float64)
        else:
            raise InputError(f"{name} cannot be read: copy the file again")
    return result


def _choose(listed: list[tuple[str, tuple[int, ...], str]], numbers: Sequence[str], texts: Sequence[str]) -> list[str]:
    """The wanted names that are there, refused where they are of another kind."""
    wanted: list[str] = []
    for name, shape, kind in listed:
        if name not in numbers and name not in texts:
            continue
        if name in wanted:
            raise InputError(f"{name} stands twice: save the file again")
        count = int(np.prod(np.array(shape, dtype=object))) if shape else 0
        fits = kind in NUMBERS if name in numbers else kind == "char" and count <= LONGEST_TEXT
        if not fits or not 0 < count <= LARGEST_VARIABLE // 8:
            raise InputError(f"{name} is a {' x '.join(map(str, shape))!s:.40} {kind}: it must be a few numbers")
        wanted.append(name)
    return wanted


def _inflate(data: bytes) -> bytes:
    """The same file with nothing compressed and without variables that are larger than LARGEST_VARIABLE."""
    if len(data) < HEADER or data[:10] != b"MATLAB 5.0" or data[126:128] not in (b"IM", b"MI"):
        raise InputError("it is no MATLAB 5 file: save it again with save -v7")
    order = "<" if data[126:128] == b"IM" else ">"
    parts, place, total = [data[:HEADER]], HEADER, 0
    while place < len(data):
        if len(data) - place < 8:
            raise InputError("it is cut off: copy it again")
        kind, length = struct.unpack_from(f"{order}II", data, place)
        body = data[place + 8 : place + 8 + length]
        if len(body) < length:
            raise InputError("it is cut off: copy it again")
        element = _expand(body) if kind == COMPRESSED else data[place : place + 8 + length]
        if element is not None and len(element) <= LARGEST_VARIABLE + 8:
            inner, size = struct.unpack_from(f"{order}II", element.ljust(8, b"\0"))
            if inner != MATRIX or size != len(element) - 8:
                raise InputError(f"it is damaged: a variable of type {inner} with {size} bytes; copy it again")
            parts.append(element)
            total += len(element)
            if total > LARGEST_CONTENT:
                raise InputError(f"it inflates to more than {LARGEST_CONTENT >> 20} MiB: is it a calibration?")
        place += 8 + length
    return b"".join(parts)


def _expand(body: bytes) -> bytes | None:
    """A compressed element, or None where it is too large to be one of ours."""
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
