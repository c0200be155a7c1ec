"""Take pairs of pictures with two cameras, or from two video files as if they were cameras."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2

from stereo_gpu.errors import InputError
from stereo_gpu.files import check_writable, whole_folder
from stereo_gpu.images import write_png
from stereo_gpu.types import Picture


@dataclass(frozen=True, kw_only=True)
class Taken:
    """One pair that was written.

    Args:
        number: counts from 1.
        left, right: the files.
        skew_ms: time between the two cameras' grabs, milliseconds.
    """

    number: int
    left: Path
    right: Path
    skew_ms: float


def capture(left: str, right: str, folder: Path, *, count: int = 15, interval: float = 2.0) -> Iterator[Taken]:
    """Take `count` pairs, one every `interval` seconds, and write left0001.png, right0001.png and so on.

    Both cameras grab before either picture is decoded, so that the skew between them stays small. A video file
    plays at its own speed: interval seconds of its frames are passed over. It ends when either source does.

    Args:
        left, right: number of a camera, a device's path, or a video file.
        folder: where the pictures go; made if missing.
        count: how many pairs.
        interval: seconds between pairs.

    Raises:
        InputError: a source cannot be opened or gives no picture, the sizes differ, or the folder cannot be written.
    """
    if count < 1:
        raise InputError(f"count = {count}: take at least 1 pair")
    if not 0 <= interval < math.inf:
        raise InputError(f"interval = {interval:g}: give 0 seconds or more between pairs")
    check_writable(folder)
    sources = [_open(name) for name in (left, right)]
    try:
        for number in range(1, count + 1):
            if number > 1:
                _wait(sources, (left, right), interval)
            grabs = []
            for source in sources:
                if not source.grab():
                    break
                grabs.append(time.perf_counter())
            if len(grabs) < 2:
                if number == 1:
                    raise InputError(
                        f"{(left, right)[len(grabs)]} opened but gives no picture: is it in use elsewhere?"
                    )
                return
            pictures = [_retrieve(source, name) for source, name in zip(sources, (left, right), strict=True)]
            sizes = [f"{p.shape[1]} x {p.shape[0]}" for p in pictures]
            if sizes[0] != sizes[1]:
                raise InputError(f"{left} gives {sizes[0]}, {right} gives {sizes[1]}: set both cameras to one size")
            names = [f"{side}{number:04d}.png" for side in ("left", "right")]
            with whole_folder(folder) as new:
                for name, picture in zip(names, pictures, strict=True):
                    write_png(new / name, picture)
            skew = 1000 * (grabs[1] - grabs[0])
            yield Taken(number=number, left=folder / names[0], right=folder / names[1], skew_ms=skew)
    finally:
        for source in sources:
            source.release()


def _retrieve(source: cv2.VideoCapture, name: str) -> Picture:
    """The picture that was grabbed last, in RGB."""
    decoded, picture = source.retrieve()
    if not decoded:
        raise InputError(f"{name} gave a picture that cannot be decoded: check the cable, or convert the video")
    result: Picture = cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)
    return result


def _open(name: str) -> cv2.VideoCapture:
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        source = cv2.VideoCapture(int(name) if name.isdigit() else name)
    finally:
        cv2.utils.logging.setLogLevel(level)
    if not source.isOpened():
        raise InputError(
            f"camera or video {name!r} cannot be opened: check that it is there and that nothing else uses it"
        )
    return source


def _wait(sources: list[cv2.VideoCapture], names: tuple[str, str], interval: float) -> None:
    """Let the interval pass: pass over a video's frames, and empty a camera's queue so that the next grab is fresh."""
    until = time.perf_counter() + interval
    live = []
    for source, name in zip(sources, names, strict=True):
        if Path(name).is_file():
            for _ in range(max(0, round(interval * source.get(cv2.CAP_PROP_FPS)) - 1)):
                source.grab()
        else:
            live.append(source)
    while live and time.perf_counter() < until:
        for source in live:
            source.grab()
