"""Where pictures come from: what every kind of source can do, and which kind a name means.

A source is used from one thread only. A name that is a whole number is a camera's; a folder is its pictures in order;
a URL is a stream; a device's path is a camera; any other path is a video file.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from stereo_gpu.errors import InputError
from stereo_gpu.recording.settings import NO_SETTINGS, CameraSettings
from stereo_gpu.types import Picture

Name = str | int | os.PathLike[str]


class Source(Protocol):
    """One camera, stream, video file or folder."""

    name: str
    live: bool  # goes on whether or not it is read, and may come back after it has failed
    period_s: float  # between two pictures, as it says itself
    stamped: bool  # its times are those of the pictures themselves, not of when they were read
    warm_up_s: float  # so long its exposure is settling at first

    def grab(self) -> float | None:
        """Take the next picture without decoding it; its time in seconds, or None where there is none."""
        ...

    def retrieve(self) -> Picture:
        """Decode what was grabbed last: (H, W, 3) RGB or (H, W).

        Raises:
            InputError: it cannot be decoded.
        """
        ...

    @property
    def ended(self) -> str:
        """Why there is no further picture, if its end was reached; empty if it failed."""
        ...

    @property
    def settings(self) -> dict[str, float]:
        """What it runs with, by the names of `CameraSettings`; only what it tells."""
        ...

    @property
    def refused(self) -> tuple[str, ...]:
        """Which of the wanted settings it did not take."""
        ...

    def close(self) -> None:
        """Let it go."""
        ...


Opener = Callable[[], Source]


def find_openers(left: Name, right: Name | None, wanted: CameraSettings = NO_SETTINGS) -> tuple[Opener, ...]:
    """How to open the source of each view; one opener where `right` is None. Nothing is opened yet.

    Raises:
        InputError: the names mean nothing, two different clocks, or a folder holds no picture.
    """
    from stereo_gpu.recording.folder_source import FolderSource, number_pictures
    from stereo_gpu.recording.video_source import VideoSource, is_live, without_account

    names = [_text(name) for name in (left, right) if name is not None]
    shown = [without_account(name) for name in names]
    folders = [is_folder(name) for name in names]
    live = [not folder and is_live(name) for name, folder in zip(names, folders, strict=True)]
    if len(names) == 2:
        if live[0] != live[1] or folders[0] != folders[1]:
            told = [
                f"{name} is {'a folder' if folder else 'a camera or stream' if goes_on else 'a video file'}"
                for name, folder, goes_on in zip(shown, folders, live, strict=True)
            ]
            raise InputError(f"{', '.join(told)}: their times cannot be compared, give two of a kind")
        if live[0] and names[0] == names[1]:
            raise InputError(f"{shown[0]} is given for both cameras: name two, or one with both views side by side")
    if folders[0]:
        listed = number_pictures([Path(name) for name in names], wanted.fps)
        return tuple(lambda part=part: FolderSource(part, wanted) for part in listed)
    return tuple(lambda name=name: VideoSource(name, wanted) for name in names)


def is_folder(name: str) -> bool:
    """Whether the name means a folder; a number never does, even where a folder is called so."""
    try:
        return not name.isdecimal() and Path(name).is_dir()
    except OSError:  # too long for a file's name, as a stream's may be, or in a folder that is closed to us
        return False


def _text(name: Name) -> str:
    text = os.fspath(name) if isinstance(name, os.PathLike) else str(name)
    if not text or "\0" in text:
        raise InputError(f"camera or video {text!r} cannot be opened: give a number, a path or a URL")
    return text
