"""What the desk's worker does: a pair to the rectified view that somebody paints on, and what was painted to a mask."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from stereo_gpu.backends import open_backend
from stereo_gpu.errors import InputError, StereoError
from stereo_gpu.images import read_image
from stereo_gpu.mask import Stroke, mask_from_strokes
from stereo_gpu.match_options import parse_view
from stereo_gpu.rectify import rectify
from stereo_gpu.rig import Rig
from stereo_gpu.scene import build_scene
from stereo_gpu.service.data.folders import written
from stereo_gpu.types import Picture, View

VIEW, PICTURE = "view.png", "picture.jpg"  # the view as it is, and what is shown of it
LARGEST = 2048  # px a side, of what is shown: a phone has fewer
QUALITY = 88  # of JPEG
QUICK = 1  # of PNG's levels: it is kept for an hour
WARM_SIZE = 160, 120  # px
Rectangle = tuple[int, int, int, int]
Strokes = Sequence[tuple[float, Sequence[tuple[float, float]]]]  # radius and points of each


def prepare(*, backend: str | None) -> None:
    """Open the device, compile what rectifies, and cut something out, so that the first view comes at once.

    Raises:
        BackendError: the device is missing or fails.
    """
    open_backend(backend)
    flat = np.full((WARM_SIZE[1], WARM_SIZE[0], 3), 90, np.uint8)
    rectify(flat, flat, build_scene(WARM_SIZE).rig, backend=backend)
    cv2.circle(flat, (80, 60), 20, (200, 60, 60), -1)
    mask_from_strokes(flat, rectangle=(50, 30, 60, 60))


def do_task(what: str, folder: Path, given: tuple[object, ...], *, backend: str | None) -> object:
    """One task of the desk; `what` is "view" or "mask", `given` the rest of its arguments.

    Raises:
        DiskFull, StoreError: the folder cannot be written, or a file of it is gone.
        StereoError: one line, in which nothing tells where the service keeps its files.
    """
    try:
        with written(folder):
            return draw_view(folder, *given, backend=backend) if what == "view" else draw_mask(folder, *given)  # type: ignore[arg-type]
    except StereoError as error:
        line = str(error)
        for place in (folder, *(part.parent for part in given if isinstance(part, Path))):  # the rig's, too
            line = line.replace(f"{place}/", "")
        raise type(error)(line) from error


def draw_view(
    folder: Path, left: str, right: str, rig: Path, reference: str, *, backend: str | None
) -> tuple[int, int]:
    """Write VIEW and PICTURE of a pair, whose files lie in the folder; gives the view's width and height.

    Raises:
        InputError: a picture cannot be read, or does not fit the other or the rig.
        BackendError: the device is missing or fails.
    """
    pair = rectify(read_image(folder / left), read_image(folder / right), Rig.load(rig), backend=backend)
    view = pair.left if parse_view(reference) is View.LEFT else pair.right
    _write(folder / VIEW, view, [cv2.IMWRITE_PNG_COMPRESSION, QUICK])
    height, width = view.shape[:2]
    shown, scale = _eight_bits(view), min(1.0, LARGEST / max(width, height))
    if scale < 1:
        shown = cv2.resize(shown, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    _write(folder / PICTURE, shown, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return width, height


def draw_mask(folder: Path, rectangle: Rectangle | None, wanted: Strokes, unwanted: Strokes) -> bytes:
    """A PNG, white where the object is.

    Args:
        folder: in which VIEW lies.
        rectangle: around it, or None.
        wanted, unwanted: (radius, points) of each stroke.

    Raises:
        InputError: the marks are wrong, or nothing is found by them.
    """
    strokes = [[Stroke(radius=radius, points=points) for radius, points in marks] for marks in (wanted, unwanted)]
    mask = mask_from_strokes(_view(folder / VIEW), rectangle=rectangle, wanted=strokes[0], unwanted=strokes[1])
    return cv2.imencode(".png", mask * 255)[1].tobytes()


@lru_cache(2)  # whoever paints, paints on one view for a while
def _view(path: Path) -> Picture:
    return read_image(path)


def _eight_bits(picture: Picture) -> Picture:
    if picture.dtype == np.uint8:
        return picture
    # Many cameras put 10 or 12 bits into 16: the bright end tells how many.
    bright = float(np.percentile(picture[::4, ::4], 99.9))
    eight: Picture = cv2.convertScaleAbs(picture, alpha=255.0 / max(1.0, bright))
    return eight


def _write(path: Path, picture: Picture, options: list[int]) -> None:
    stored = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    coded, data = cv2.imencode(path.suffix, stored, options)
    if not coded:
        raise InputError(f"the view of {picture.shape[1]} x {picture.shape[0]} px cannot be written: scale it down")
    path.write_bytes(data.tobytes())
