"""Read and write disparity maps as PFM, the format of Middlebury's stereo benchmark."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.files import write_whole
from stereo_gpu.types import Floats

_HEADER_LINE = 100  # a width, a height or a scale needs no more bytes than this


def write_pfm(path: str | os.PathLike[str], values: Floats) -> Path:
    """Write (H, W) float32 values little endian, bottom row first, as the format wants; NaN becomes infinity.

    Raises:
        InputError: `values` is not a picture of one channel, or the file cannot be written.
    """
    if values.ndim != 2:
        raise InputError(f"a PFM takes values of shape (H, W), not {values.shape}: pass one channel")
    height, width = values.shape
    data = np.where(np.isnan(values), np.inf, values)[::-1].astype("<f4")
    return write_whole(path, b"Pf\n%d %d\n-1.0\n" % (width, height) + data.tobytes())


def read_pfm(path: str | os.PathLike[str]) -> Floats:
    """Read a PFM of one channel as (H, W) float32, top row first, of either byte order; infinity becomes NaN.

    Raises:
        InputError: the file is missing, is no such PFM or is cut off.
    """
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}; check the name") from error
    parts = content[: 4 * _HEADER_LINE].split(b"\n", 3)
    try:
        kind, size, scale = (part.strip() for part in parts[:3])
        width, height = (int(number) for number in size.split())
        order = "<f4" if float(scale) < 0 else ">f4"
    except ValueError:
        raise InputError(f"{path} is not a PFM: its first lines must be Pf, width and height, and a scale") from None
    if kind != b"Pf" or width < 1 or height < 1:
        raise InputError(f"{path} is not a PFM of one channel: it starts with {content[:2]!r}, pass one with b'Pf'")
    data = content[sum(len(part) + 1 for part in parts[:3]) :]
    if len(data) < 4 * width * height:
        raise InputError(
            f"{path} is cut off: {width} x {height} values need {4 * width * height} bytes, it has {len(data)};"
            " get it again"
        )
    values = np.frombuffer(data, order, width * height).reshape(height, width)[::-1].astype(np.float32)
    return np.where(np.isfinite(values), values, np.float32(np.nan))
