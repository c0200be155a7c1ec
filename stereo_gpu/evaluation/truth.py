"""Read disparity maps and their truth from the formats of the stereo benchmarks."""

from __future__ import annotations

import os
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.errors import InputError
from stereo_gpu.images import read_image
from stereo_gpu.pfm import read_pfm
from stereo_gpu.types import Floats, Picture

KITTI_SCALE = 256.0  # grey levels a px of the 16-bit pictures of KITTI and most who store disparities so


def read_disparity(path: str | os.PathLike[str], scale: float | None = None) -> Floats:
    """Read a disparity map as (H, W) float32 px, NaN where it has no value.

    | file | no value | scale by default |
    | --- | --- | --- |
    | .pfm, either byte order | not finite | 1 |
    | .npy, or .npz with one array, of any kind of number | not finite | 1 |
    | picture of 16 bits (KITTI) | 0 | 256 |
    | picture of 8 bits (Middlebury 2001 to 2006) | 0 | none: it differs from pair to pair |

    Args:
        path: the file; its ending tells PFM and NumPy's formats, anything else is read as a picture.
        scale: what the file holds for one px of disparity; None takes the format's.

    Raises:
        InputError: the file is missing, damaged, no map of one channel, or of 8 bits without a scale; or the scale is
            not a positive number.
    """
    path = Path(path)
    if scale is not None and not (np.isfinite(scale) and scale > 0):
        raise InputError(f"{path}: scale = {scale} is no positive number; give what stands for one px, such as 4")
    ending = path.suffix.lower()
    if ending == ".pfm":
        values = read_pfm(path)
    elif ending in (".npy", ".npz"):
        values = _read_numpy(path)
    else:
        values, scale = _read_levels(path, scale)
    with np.errstate(over="ignore"):  # doubles that float32 cannot hold become infinite, which is no value
        scaled = np.asarray(values / (scale or 1.0), np.float32)
    return np.where(np.isfinite(scaled), scaled, np.float32(np.nan))


def read_truth(path: str | os.PathLike[str], scale: float | None = None) -> Floats:
    """Read a map as `read_disparity` does, and make sure that it knows something.

    Raises:
        InputError: as `read_disparity`, or no pixel has a value.
    """
    truth = read_disparity(path, scale)
    if not np.isfinite(truth).any():
        raise InputError(f"{path} knows the truth of none of its {truth.size} pixels: give another file")
    return truth


def read_confidence(path: str | os.PathLike[str]) -> Floats:
    """Read how sure a map is of each pixel, (H, W) float32, more is surer: PFM, .npy, .npz or a grey picture.

    Grey levels are stretched to 0..1.

    Raises:
        InputError: the file is missing, damaged or not of one channel.
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending == ".pfm":
        return read_pfm(path)
    if ending in (".npy", ".npz"):
        return np.asarray(_read_numpy(path), np.float32)
    picture = read_grey(path)
    return np.asarray(picture / np.iinfo(picture.dtype).max, np.float32)


def _read_levels(path: Path, scale: float | None) -> tuple[Floats, float]:
    """Grey levels, NaN for 0, and the scale that they are to be divided by."""
    picture = read_grey(path)
    if scale is None:
        if picture.dtype == np.uint8:
            raise InputError(f"{path} has 8 bits: say how many grey levels are one px, as 4 for Middlebury's Teddy")
        scale = KITTI_SCALE
    return np.where(picture == 0, np.nan, picture).astype(np.float32), scale


def read_grey(path: Path) -> Picture:
    """Read a picture in grey, (H, W), be it stored as RGB, as Tsukuba's truth is.

    Raises:
        InputError: no such picture, or in colour: a rendering holds no numbers.
    """
    picture = read_image(path)
    if picture.ndim == 2:
        return picture
    if (picture != picture[..., :1]).any():
        raise InputError(f"{path} is in colour: give the map or mask itself, in grey, not a rendering of it")
    return picture[..., 0]


def _read_numpy(path: Path) -> NDArray[Any]:
    """The array of a .npy file, or the only one of a .npz file, as floats."""
    try:
        with path.open("rb") as stream:  # np.load leaves a broken archive open that it opened itself
            loaded = np.load(stream, allow_pickle=False)
            if isinstance(loaded, np.lib.npyio.NpzFile):
                if len(loaded.files) != 1:
                    raise InputError(f"{path} holds {len(loaded.files)} arrays: store the map alone")
                loaded = loaded[loaded.files[0]]
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}; check the name") from error
    except (ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(f"{path} is no file of numbers that NumPy wrote ({error}): write it again") from error
    if loaded.ndim != 2 or loaded.dtype.kind not in "fiu" or not loaded.size:
        raise InputError(f"{path} holds {loaded.dtype} of shape {loaded.shape}: a map is numbers of shape (H, W)")
    return np.asarray(loaded, np.float64)
