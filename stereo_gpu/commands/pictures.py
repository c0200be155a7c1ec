"""Which pictures a command was given."""

from __future__ import annotations

import glob
from collections.abc import Sequence
from pathlib import Path

from stereo_gpu.errors import InputError
from stereo_gpu.images import PICTURE_SUFFIXES
from stereo_gpu.types import Bytes


def split_pictures(given: Sequence[str]) -> tuple[list[Path], list[Path]]:
    """Tell left pictures from right ones: two folders, two patterns, or one list whose first half is left.

    Raises:
        InputError: a folder or pattern holds no picture, or the list has an odd length.
    """
    if len(given) == 2:
        return _expand(given[0]), _expand(given[1])
    if len(given) % 2:
        raise InputError(f"{len(given)} pictures cannot be pairs: give all left ones, then as many right ones")
    half = len(given) // 2
    return [Path(name) for name in given[:half]], [Path(name) for name in given[half:]]


def _expand(name: str) -> list[Path]:
    path = Path(name)
    if path.is_dir():
        found = sorted(file for file in path.iterdir() if file.suffix.lower() in PICTURE_SUFFIXES)
        if not found:
            raise InputError(f"folder {name} holds no picture: it needs files such as left01.png")
        return found
    if any(sign in name for sign in "*?["):
        found = sorted(Path(match) for match in glob.glob(name))  # noqa: PTH207 - takes absolute patterns too
        if not found:
            raise InputError(f"no picture matches {name}: check the pattern and the folder")
        return found
    return [path]


def read_mask(path: Path | None, shape: tuple[int, ...]) -> Bytes | None:
    """(H, W) uint8, from a file; None where there is none."""
    from stereo_gpu.mask import mask_from_file

    return None if path is None else mask_from_file(path, (shape[1], shape[0]))
