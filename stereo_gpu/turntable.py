"""A short film of a model that turns, as GIF, WebP or MP4."""

from __future__ import annotations

import io
import math
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from stereo_gpu.backends import Backend
from stereo_gpu.errors import InputError, StereoError
from stereo_gpu.files import check_writable_file, write_whole
from stereo_gpu.render import BACKGROUND, Colour, Renderer, Shading
from stereo_gpu.types import Bytes, Mesh, Surface

SUFFIXES = (".gif", ".webp", ".mp4")
FULL_TURN = 360.0  # degrees of swing at which the camera goes all the way round
MOST_FRAMES = 3000
_PITCH = 8.0  # degrees
_LIFT = 0.2  # of the swing, that the camera rises and sinks: on its way back it shows the model from elsewhere
_SAMPLED = 8  # frames that a GIF's colours are chosen from
_WEBP_QUALITY = 80
# A film within a page: as small as it may be without looking poor, since every report pays for it.
_PAGE_SIZE, _PAGE_SECONDS, _PAGE_FPS, _PAGE_SWING = (320, 240), 2.0, 8.0, 15.0

Told = Callable[[int, int], None]


def turntable(
    model: Mesh | Surface,
    path: str | os.PathLike[str],
    *,
    size: tuple[int, int] = (640, 480),
    seconds: float = 6.0,
    fps: float = 15.0,
    swing: float = 25.0,
    yaw: float = 0.0,
    pitch: float = _PITCH,
    shading: Shading | str | None = None,
    background: Colour = BACKGROUND,
    supersample: int = 2,
    device: Backend | None = None,
    progress: Told | None = None,
) -> Path:
    """Film a model from a camera that swings to and fro before it, in a loop without a seam.

    Two cameras see one side of a thing, so that a full turn would show its empty back half of the time. The camera goes
    along a flat ellipse, at the pace of a pendulum.

    Args:
        model: a textured mesh, or a bare surface.
        path: the file to write, whole or not at all; its ending says what: .gif and .webp loop in any browser, .mp4
            plays in browsers and players (VP9, since OpenCV's package cannot write H.264).
        size: (width, height) in px; of an MP4 even, or it is made so.
        seconds: how long one loop takes.
        fps: pictures a second.
        swing: degrees to either side; 360 goes all the way round, at an even pace.
        yaw, pitch: degrees, the middle of the swing.
        shading, background, supersample, device: as `render` takes them.
        progress: told how many pictures of how many are drawn.

    Raises:
        InputError: the ending is unknown, a number is out of range or the file cannot be written.
        StageError: the model has no face to draw.
        BackendError: the device is missing or fails.
    """
    path = Path(path)
    check_film(path, seconds, fps, swing)
    views = camera_path(seconds, fps, swing, yaw, pitch)
    if path.suffix.lower() == ".mp4":
        size = (size[0] + size[0] % 2, size[1] + size[1] % 2)
    renderer = Renderer(
        model, size=size, shading=shading, background=background, supersample=supersample, device=device
    )
    cameras = renderer.cameras(views)

    def frames() -> Iterator[Bytes]:
        for number, camera in enumerate(cameras, 1):
            yield renderer.draw(camera)
            if progress is not None:
                progress(number, len(cameras))

    if path.suffix.lower() == ".gif":
        some = [renderer.draw(camera) for camera in cameras[:: -(-len(cameras) // _SAMPLED)]]
        return write_whole(path, _gif(frames(), some, fps))
    if path.suffix.lower() == ".webp":
        return write_whole(path, _webp(frames(), fps))
    return write_whole(path, _mp4(frames(), size, fps))


def page_film(model: Mesh, *, device: Backend | None = None) -> tuple[Bytes, bytes]:
    """The first picture of a small turntable, (H, W, 3) RGB, and all of it as WebP, for a page to hold.

    Raises:
        StageError: the model has no face to draw.
        BackendError: the device is missing or fails.
    """
    renderer = Renderer(model, size=_PAGE_SIZE, device=device)
    cameras = renderer.cameras(camera_path(_PAGE_SECONDS, _PAGE_FPS, _PAGE_SWING, 0.0, _PITCH))
    frames = [renderer.draw(camera) for camera in cameras]
    return frames[0], _webp(iter(frames), _PAGE_FPS, effort=0)


def check_film(path: Path, seconds: float, fps: float, swing: float) -> None:
    """Refuse a film that cannot be made, before any work is done.

    Raises:
        InputError: the ending is unknown, the file cannot be written or a number is out of range.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: unknown ending '{path.suffix}' of a turntable: take {', '.join(SUFFIXES)}")
    check_writable_file(path)
    if not (0 < fps <= 100 and seconds > 0):
        raise InputError(f"{seconds:g} seconds at {fps:g} pictures a second: give seconds above 0, and fps up to 100")
    count = seconds * fps
    if not 2 <= round(min(count, 1e9)) <= MOST_FRAMES:
        raise InputError(
            f"{seconds:g} seconds at {fps:g} a second are {count:.4g} pictures: make it 2 to {MOST_FRAMES}"
        )
    if not (0 <= swing <= 180 or swing == FULL_TURN):
        raise InputError(f"swing {swing:g}: give degrees to either side, 0 to 180, or 360 for a full turn")


def camera_path(seconds: float, fps: float, swing: float, yaw: float, pitch: float) -> list[tuple[float, float]]:
    """(yaw, pitch) in degrees of each picture of a loop; the last is one step before the first."""
    count = round(seconds * fps)
    turns = [2 * math.pi * number / count for number in range(count)]
    if swing == FULL_TURN:
        return [(yaw + math.degrees(turn), pitch) for turn in turns]
    return [(yaw + swing * math.sin(turn), pitch - _LIFT * swing * math.cos(turn)) for turn in turns]


def _gif(frames: Iterator[Bytes], some: list[Bytes], fps: float) -> bytes:
    """A GIF with one set of colours, chosen from some of the pictures, so that none flickers."""
    from PIL import Image

    # One colour is left for what stays from one picture to the next.
    palette = Image.fromarray(np.concatenate(some)).quantize(255, Image.Quantize.MEDIANCUT)
    indexed = (Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    # A GIF counts in hundredths of a second, and what is shorter than two of them is shown at ten pictures a second.
    return _animation(indexed, "GIF", duration=max(20, 10 * round(100 / fps)), loop=0, disposal=1)


def _webp(frames: Iterator[Bytes], fps: float, effort: int = 2) -> bytes:
    from PIL import Image, WebPImagePlugin  # noqa: F401  # or `save` would import every plugin there is, to find it

    pictures = (Image.fromarray(frame) for frame in frames)
    return _animation(pictures, "WEBP", duration=round(1000 / fps), loop=0, quality=_WEBP_QUALITY, method=effort)


def _animation(pictures: Iterator[Any], kind: str, **options: int) -> bytes:
    packed = io.BytesIO()
    next(pictures).save(packed, kind, save_all=True, append_images=pictures, **options)
    return packed.getvalue()


def _mp4(frames: Iterator[Bytes], size: tuple[int, int], fps: float) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "film.mp4"
        writer = cv2.VideoWriter(str(file), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"vp09"), fps, size)
        if not writer.isOpened():
            raise StereoError("this OpenCV cannot write VP9: write .gif or .webp, or install opencv-python-headless")
        try:
            for frame in frames:
                writer.write(np.ascontiguousarray(frame[..., ::-1]))
        finally:
            writer.release()
        return file.read_bytes()
