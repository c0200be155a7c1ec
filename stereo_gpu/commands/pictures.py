"""Which pictures a command was given."""

from __future__ import annotations

import glob
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from stereo_gpu.errors import InputError

if TYPE_CHECKING:
    from stereo_gpu.types import Bytes

SIDES = ("left", "right")

logger = logging.getLogger(__name__)


def split_pictures(given: Sequence[str]) -> tuple[list[Path], list[Path]]:
    """Tell left pictures from right ones: two folders, two patterns, one list whose first half is left, or one folder.

    One folder is what `capture` leaves: left0001.png belongs to right0001.png, and so on.

    Raises:
        InputError: a folder or pattern holds no picture or pair, or the list has an odd length.
    """
    if len(given) == 1 and Path(given[0]).is_dir():
        return _split_folder(Path(given[0]))
    if len(given) == 2:
        return _expand(given[0]), _expand(given[1])
    if len(given) == 1:
        raise InputError(
            f"{given[0]} is no folder: name the one with left and right pictures, or two folders or patterns"
        )
    if len(given) % 2:
        raise InputError(f"{len(given)} pictures cannot be pairs: give all left ones, then as many right ones")
    half = len(given) // 2
    return [Path(name) for name in given[:half]], [Path(name) for name in given[half:]]


def _split_folder(folder: Path) -> tuple[list[Path], list[Path]]:
    files = _list(folder)
    views = [{file.stem[len(side) :]: file for file in files if file.stem.startswith(side)} for side in SIDES]
    shared = [rest for rest in views[0] if rest in views[1]]
    if not shared:
        raise InputError(f"folder {folder} holds no pair: it needs files such as left01.png and right01.png")
    alone = [file.name for own, other in (views, views[::-1]) for rest, file in own.items() if rest not in other]
    if alone:
        logger.warning("%s of %s has no partner: left out", ", ".join(alone[:5]), folder)
    return [views[0][rest] for rest in shared], [views[1][rest] for rest in shared]


def _list(folder: Path) -> list[Path]:
    from stereo_gpu.images import PICTURE_SUFFIXES

    try:
        return sorted(file for file in folder.iterdir() if file.suffix.lower() in PICTURE_SUFFIXES)
    except OSError as error:
        raise InputError(f"folder {folder} cannot be read: {error.strerror}; check its permissions") from error


def _expand(name: str) -> list[Path]:
    path = Path(name)
    if path.is_dir():
        found = _list(path)
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
