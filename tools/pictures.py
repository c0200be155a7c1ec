"""Draw docs/images/overview.jpg and turntable.webp from what the demo left in a folder."""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np

import stereo_gpu as sg
from stereo_gpu.figures import colour_disparity
from stereo_gpu.files import write_whole
from stereo_gpu.pfm import read_pfm
from stereo_gpu.types import Bytes

IMAGES = Path(__file__).parents[1] / "docs" / "images"
PANEL = (480, 360)  # px
GAP = 8
TURNTABLE = (480, 360)


def draw_overview(folder: Path, model: sg.Mesh) -> Bytes:
    """Left and right picture and disparity above the mesh, and the model from the front and from the side."""
    found = read_pfm(folder / "disparity.pfm")
    pictures = [sg.read_image(folder / "pictures" / f"{side}.png") for side in ("left", "right")]
    pictures.append(colour_disparity(np.where(np.isfinite(found), found, np.float32(np.nan))))
    shown = [np.asarray(cv2.resize(picture, PANEL, interpolation=cv2.INTER_AREA)) for picture in pictures]
    for shading, yaw, pitch in (("wire", 0.0, 0.0), ("texture", 0.0, 0.0), ("texture", 25.0, 10.0)):
        shown.append(sg.render(model, size=PANEL, yaw=yaw, pitch=pitch, shading=shading, supersample=4))
    canvas = np.full((2 * PANEL[1] + GAP, 3 * PANEL[0] + 2 * GAP, 3), 255, np.uint8)
    for number, picture in enumerate(shown):
        row, column = divmod(number, 3)
        y, x = row * (PANEL[1] + GAP), column * (PANEL[0] + GAP)
        canvas[y : y + PANEL[1], x : x + PANEL[0]] = picture
    return canvas


def main() -> None:
    """Write both pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("demo", type=Path, nargs="?", default=Path("demo-out"), help="what the demo left (%(default)s)")
    folder = parser.parse_args().demo
    model = sg.read_glb(folder / "model.glb")
    bgr = np.ascontiguousarray(draw_overview(folder, model)[..., ::-1])
    _, packed = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, 88])
    films = sg.turntable(model, IMAGES / "turntable.webp", size=TURNTABLE, seconds=6, fps=12, swing=25, supersample=3)
    for path in (write_whole(IMAGES / "overview.jpg", packed.tobytes()), films):
        print(f"{path.relative_to(IMAGES.parents[1])}: {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
