"""Cut real and rendered pairs into so small tiles that they are nearly all seams, and count the pixels that change.

Run it after a change of a kernel or of the profiles: stereo_gpu/tiles.py has to know how far each step looks.
"""

import argparse
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

import stereo_gpu as sg
from stereo_gpu import tiles
from stereo_gpu.scene import build_scene
from stereo_gpu.scene_render import render_pair

ROOT = Path(__file__).parents[1]
ALLOWED = 1e-4  # share of the pixels that may change
CHANGED = 0.01  # px


def pairs(data: Path, scene_width: int) -> Iterator[tuple[str, np.ndarray, np.ndarray, tuple[int, int]]]:
    """Name, pictures and range of each pair."""
    if data.is_dir():
        folder = data / "stereo"
        names = ("motorcycle_left.png", "motorcycle_right.png")
        left, right = (sg.read_image(folder / "motorcycle" / name) for name in names)
        yield "motorcycle", left, right, (0, 64)
        teddy = [sg.read_image(folder / "teddy" / name) for name in ("im2.png", "im6.png")]
        left, right = (cv2.resize(one, None, fx=2.5, fy=2.5, interpolation=cv2.INTER_CUBIC) for one in teddy)
        yield "teddy x 2.5", left, right, (20, 130)
    if scene_width:
        scene = build_scene((scene_width, scene_width * 3 // 4))
        pair = sg.rectify(*render_pair(scene), scene.rig)
        smallest, count = sg.match(pair.left, pair.right, disparities="auto").smallest, scene_width // 5
        yield f"scene {scene_width}", pair.left, pair.right, (smallest, count)


def difference(whole: sg.Disparity, tiled: sg.Disparity) -> tuple[float, float, float]:
    """Shares of the pixels that changed: by more than CHANGED, the same in both pictures, and in any bit.

    A pixel that has a value in one map alone has changed by more than CHANGED. In both pictures are the columns whose
    whole range lies in the other picture. The bits are those of value, validity and confidence.
    """
    a, b = whole.values, tiled.values
    same = (a == b) | (np.isnan(a) & np.isnan(b))
    with np.errstate(invalid="ignore"):
        near = same | (np.abs(a - b) <= CHANGED)
    exact = same & (whole.validity == tiled.validity) & (whole.confidence == tiled.confidence)
    low, high = whole.smallest, whole.smallest + whole.disparities
    before, after = (high, -low) if whole.reference == "left" else (-low, high)
    in_both = near[:, max(0, before) : near.shape[1] - max(0, after)]
    return float(1 - near.mean()), float(1 - in_both.mean()), float(1 - exact.mean())


def main() -> int:
    """Print the table; 1 if more changed than is allowed, at the reach in use and of the pixels in both pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--profile", nargs="+", default=["paper", "fast", "precise"])
    parser.add_argument("--reach", nargs="+", type=int, default=[tiles.PATH_REACH], help="of smooth paths, px")
    parser.add_argument("--tile", type=int, default=100, help="side of the tiles, px (%(default)s)")
    parser.add_argument(
        "--scene", type=int, default=1200, help="width of the rendered scene, px; 0: none (%(default)s)"
    )
    parser.add_argument("--reference", default="right")
    parser.add_argument("--backend")
    options = parser.parse_args()
    data = Path(os.environ.get("STEREO_GPU_DATA", ROOT / ".." / "shared" / "data"))
    in_use, failed = tiles.PATH_REACH, False
    print(f"| pair | profile | reach | tiles | differ by more than {CHANGED} px | of those in both | differ in a bit |")
    print("| --- | --- | ---: | ---: | ---: | ---: | ---: |")
    for name, left, right, disparities in pairs(data, options.scene):
        for profile in options.profile:
            job = {"disparities": disparities, "profile": profile, "reference": options.reference}
            whole = sg.match(left, right, **job, backend=options.backend)
            assert whole.options["tiles"] == [1, 1], "too little memory to match the whole picture"
            for reach in options.reach if profile == "precise" else options.reach[:1]:
                tiles.PATH_REACH = reach
                tiled = sg.match(left, right, **job, tile=options.tile, backend=options.backend)
                changed, in_both, inexact = difference(whole, tiled)
                failed |= in_both > ALLOWED and reach == in_use
                grid = " x ".join(map(str, tiled.options["tiles"]))
                print(
                    f"| {name} | {profile} | {reach} | {grid} | {changed:.4%} | {in_both:.4%} | {inexact:.4%} |",
                    flush=True,
                )
            tiles.PATH_REACH = in_use
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
