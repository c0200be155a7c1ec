"""Pictures from a folder, as if a camera delivered them one after the other."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from stereo_gpu.errors import InputError
from stereo_gpu.images import PICTURE_SUFFIXES, read_image
from stereo_gpu.recording.settings import NO_SETTINGS, CameraSettings
from stereo_gpu.types import Picture

USUAL_RATE = 30.0  # pictures a second, where none is given: a folder tells no time
SHARED = 0.5  # of the numbers in the names: then both folders count the same moments
NANOSECONDS = 10**15  # a number as large as this in a name is a time stamp in ns, as in the EuRoC data


@dataclass(frozen=True)
class NumberedPictures:
    """A folder's pictures with their times.

    Args:
        folder: where they are.
        files, times_s: in the order of time.
        period_s: between two pictures.
    """

    folder: Path
    files: tuple[Path, ...]
    times_s: tuple[float, ...]
    period_s: float


def number_pictures(folders: Sequence[Path], fps: float | None = None) -> list[NumberedPictures]:
    """The pictures of one or two folders with their times.

    The last number in a name counts moments, or is a time stamp in nanoseconds, if both folders share most of these
    numbers: so a picture that one of them lacks leaves a gap. Else the pictures are taken in the order of their names.

    Raises:
        InputError: a folder cannot be read or holds no picture.
    """
    listed = [_list(folder) for folder in folders]
    numbers = [[_number(file) for file in files] for files in listed]
    known = [set(own) for own in numbers]
    # -1 stands for a name without a number.
    counting = all(min(own) >= 0 and len(own) == len(files) for own, files in zip(known, listed, strict=True))
    shared = len(set.intersection(*known)) >= SHARED * max(len(own) for own in known)
    stamps = counting and min(min(own) for own in known) >= NANOSECONDS
    period = 1 / (fps or USUAL_RATE)
    result = []
    for folder, files, own in zip(folders, listed, numbers, strict=True):
        if stamps:
            times = [number / 1e9 for number in own]
        elif counting and shared:
            times = [number * period for number in own]
        else:
            times = [index * period for index in range(len(files))]
        ordered = sorted(zip(times, files, strict=True))
        result.append(
            NumberedPictures(folder, tuple(file for _, file in ordered), tuple(time for time, _ in ordered), period)
        )
    return result


class FolderSource:
    """A folder's pictures in the order of time."""

    live = False
    stamped = True
    warm_up_s = 0.0

    def __init__(self, pictures: NumberedPictures, wanted: CameraSettings = NO_SETTINGS) -> None:
        # Pictures that were taken are as they are; only their rate can be told.
        self.refused = tuple(name for name in wanted.asked if name != "fps")
        self.name = str(pictures.folder)
        self.period_s = pictures.period_s
        self.settings: dict[str, float] = {}
        self._pictures = pictures
        self._next = 0

    def grab(self) -> float | None:
        """Go on to the next picture; its time in seconds, or None at the end."""
        if self._next == len(self._pictures.files):
            return None
        self._next += 1
        return self._pictures.times_s[self._next - 1]

    def retrieve(self) -> Picture:
        """Read the picture, in RGB."""
        return read_image(self._pictures.files[self._next - 1])

    @property
    def ended(self) -> str:
        """That all of its pictures were given."""
        return f"{self.name} ended after {self._next} pictures"

    def close(self) -> None:
        """Nothing is open."""


def _list(folder: Path) -> list[Path]:
    try:
        found = [file for file in folder.iterdir() if file.suffix.lower() in PICTURE_SUFFIXES and file.is_file()]
    except OSError as error:
        raise InputError(f"folder {folder} cannot be read: {error.strerror or error}; check its permissions") from error
    if not found:
        raise InputError(f"folder {folder} holds no picture: it needs files such as left01.png")
    return sorted(found, key=_natural)


def _natural(file: Path) -> list[tuple[int, str]]:
    """Orders img2 before img10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"([0-9]+)", file.name)]


def _number(file: Path) -> int:
    found = re.findall(r"[0-9]+", file.stem)
    return int(found[-1]) if found else -1
