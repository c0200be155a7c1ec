"""A picture of each step of a reconstruction, for whoever watches it."""

from __future__ import annotations

import logging
from pathlib import Path

import cv2
import numpy as np

from stereo_gpu import figures
from stereo_gpu.backends import open_backend
from stereo_gpu.engines.executor import Tell
from stereo_gpu.files import write_whole
from stereo_gpu.render import Shading, render
from stereo_gpu.result import PITCH, YAW
from stereo_gpu.service.jobs.order import STEP
from stereo_gpu.types import Bytes, Disparity, Mesh, Picture, RectifiedPair, Surface, View

LARGEST_SIDE = 960  # px
QUALITY = 85  # of JPEG
MODEL_SIZE = 640, 480  # px

log = logging.getLogger("stereo_gpu.service")


class StepPictures:
    """Draws what `reconstruct` shows: NAME.jpg whole or not at all, and then tells `step:NAME`.

    A picture that cannot be drawn or written is left out, and logged: nobody shall lose a model for it.

    Args:
        folder: of the pictures, made if missing.
        reference: the view that the maps are laid out on.
        backend: where models are drawn.
        tell: told of each picture.
    """

    def __init__(self, folder: Path, reference: str, backend: str | None, tell: Tell) -> None:
        self._folder, self._reference, self._backend, self._tell = folder, reference, backend, tell
        self._view: Picture | None = None

    def __call__(self, name: str, thing: object) -> None:
        """Draw a step, if it is one of those that are drawn."""
        try:
            drawn = self._draw(name, thing)
            if drawn is not None:
                self._write(*drawn)
        except Exception as error:
            log.warning("no picture of %s: %s", name, error)

    def _draw(self, name: str, thing: object) -> tuple[str, Bytes] | None:
        match name, thing:
            case "pair", RectifiedPair():
                self._view = _shrunk(thing.left if self._reference == View.LEFT else thing.right)
                half = (LARGEST_SIDE - figures.GAP) // 2
                left, right = (_shrunk(picture, half) for picture in (thing.left, thing.right))
                return "rectified", figures.side_by_side(left, right, level_lines=True)
            case "wanted", np.ndarray() if self._view is not None:
                wanted = cv2.resize(thing, self._view.shape[1::-1], interpolation=cv2.INTER_NEAREST)
                return "masked", figures.masked(self._view, wanted)
            case "disparity", Disparity():
                step = -(-max(thing.values.shape) // LARGEST_SIDE)
                return "disparity", figures.colour_disparity(thing.values[::step, ::step])
            case "smoothed", Surface():
                return "mesh", self._model(thing, Shading.WIRE)
            case "mesh", Mesh():
                return "textured", self._model(thing, Shading.TEXTURE)
        return None

    def _model(self, model: Mesh | Surface, shading: Shading) -> Bytes:
        device = open_backend(self._backend)
        return render(model, size=MODEL_SIZE, shading=shading, yaw=YAW, pitch=PITCH, device=device)

    def _write(self, name: str, picture: Bytes) -> None:
        self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        coded, data = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        if coded:
            write_whole(self._folder / f"{name}.jpg", data.tobytes())
            self._tell(f"{STEP}{name}")


def _shrunk(picture: Picture, side: int = LARGEST_SIDE) -> Picture:
    """The picture with its longer side no longer than that; 16 bits as bright as a person can see them."""
    scale = side / max(picture.shape[:2])
    if scale < 1:
        picture = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    if picture.dtype == np.uint16:
        bright = max(1.0, float(np.percentile(picture, 99.9)))
        picture = np.clip(picture * (255.0 / bright), 0, 255).astype(np.uint8)
    return picture
