"""Hold the disparity maps of every profile, and of OpenCV's semi-global matcher, against Middlebury's truth.

Prints the tables of docs/accuracy.md. Every map is laid out on the left view, where the truth is.
"""

import argparse
import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

import stereo_gpu as sg

ROOT = Path(__file__).parents[1]
PROFILES = ("paper", "fast", "precise")
# Left and right picture, how many grey levels of the truth are one pixel, how many disparities are searched.
GRADED = {"teddy": ("im2.png", "im6.png", 4, 64), "tsukuba": ("im3.png", "im4.png", 16, 16)}
MOTORCYCLE_DISPARITIES = 64
OPENCV = (("SGBM 3x3", 3, False), ("SGBM 3x3 filtered", 3, True), ("SGBM 5x5 filtered", 5, True))


def opencv_map(left: np.ndarray, right: np.ndarray, disparities: int, window: int, filtered: bool) -> np.ndarray:
    """The map of cv2.StereoSGBM with 8 paths, on the left view, NaN where it gives none.

    It sees grey pictures, on which it does better than in colour, with the penalties and, if asked, the filters of
    OpenCV's sample stereo_match.py. As it gives no value to the first `disparities` columns, the pictures get that
    many more on the left: its map is then as wide as ours.
    """
    filters = {"disp12MaxDiff": 1, "uniquenessRatio": 10, "speckleWindowSize": 100, "speckleRange": 32}
    matcher = cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=disparities,
        blockSize=window,
        P1=8 * window * window,
        P2=32 * window * window,
        mode=cv2.StereoSGBM_MODE_HH,
        **(filters if filtered else {"disp12MaxDiff": -1}),
    )
    grey = [cv2.cvtColor(p, cv2.COLOR_RGB2GRAY) for p in (left, right)]
    wide = [cv2.copyMakeBorder(p, 0, 0, disparities, 0, cv2.BORDER_REPLICATE) for p in grey]
    found = matcher.compute(*wide)[:, disparities:].astype(np.float32) / 16
    return np.where(found < 0, np.nan, found)


def maps(
    left: np.ndarray, right: np.ndarray, disparities: int, backend: str | None
) -> Iterator[tuple[str, np.ndarray]]:
    """Name and map of every matcher."""
    for profile in PROFILES:
        found = sg.match(left, right, disparities=(0, disparities), reference="left", profile=profile, backend=backend)
        yield profile, found.values
    for name, window, filtered in OPENCV:
        yield name, opencv_map(left, right, disparities, window, filtered)


def graded(folder: Path, name: str, backend: str | None) -> Iterator[str]:
    """A line a matcher: shares of the non-occluded pixels with truth that are wrong by more than 1 px."""
    left_name, right_name, scale, disparities = GRADED[name]
    left, right = (sg.read_image(folder / name / file) for file in (left_name, right_name))
    truth = cv2.imread(str(folder / name / "groundtruth.png"), cv2.IMREAD_GRAYSCALE).astype(np.float64) / scale
    counted = (cv2.imread(str(folder / name / "nonocc.png"), cv2.IMREAD_GRAYSCALE) == 255) & (truth > 0)
    yield f"{name}, {left.shape[1]} x {left.shape[0]} x {disparities}, {int(counted.sum())} non-occluded pixels"
    yield f"{'':18} {'bad-1.0':>9} {'of the given':>13} {'coverage':>9}"
    for matcher, values in maps(left, right, disparities, backend):
        given = np.isfinite(values)
        wrong = np.abs(values - truth) > 1
        yield (
            f"{matcher:18} {(wrong | ~given)[counted].mean():9.1%} {wrong[counted & given].mean():13.1%}"
            f" {given[counted].mean():9.1%}"
        )


def motorcycle(folder: Path, backend: str | None) -> Iterator[str]:
    """A line a matcher: absolute errors in px and, through the published geometry, in mm of depth."""
    left, right = (sg.read_image(folder / "motorcycle" / f"motorcycle_{side}.png") for side in ("left", "right"))
    truth = np.load(folder / "motorcycle" / "motorcycle_disp.npz")["arr_0"]
    camera = json.loads((folder / "motorcycle" / "calib.json").read_text("utf-8"))
    known = np.isfinite(truth)

    def depth(disparity: np.ndarray) -> np.ndarray:
        return camera["baseline_mm"] * camera["focal_px"] / (disparity + camera["doffs_px"])

    depths = depth(truth[known])
    yield (
        f"motorcycle, {left.shape[1]} x {left.shape[0]} x {MOTORCYCLE_DISPARITIES}, {int(known.sum())} pixels with"
        f" truth (occluded ones too), {depths.min():.0f} to {depths.max():.0f} mm away"
    )
    yield (
        f"{'':18} {'median px':>10} {'mean px':>8} {'median mm':>10} {'mean mm':>8} {'bad-1.0':>9}"
        f" {'of the given':>13} {'coverage':>9}"
    )
    for matcher, values in maps(left, right, MOTORCYCLE_DISPARITIES, backend):
        given = known & np.isfinite(values)
        pixels = np.abs(values - truth)
        lengths = np.abs(depth(values[given]) - depth(truth[given]))
        yield (
            f"{matcher:18} {np.median(pixels[given]):10.2f} {pixels[given].mean():8.2f} {np.median(lengths):10.1f}"
            f" {lengths.mean():8.1f} {(~given | (pixels > 1))[known].mean():9.1%} {(pixels > 1)[given].mean():13.1%}"
            f" {given[known].mean():9.1%}"
        )


def main() -> int:
    """Print the tables; the exit status is 1 where the pictures are missing."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--data",
        type=Path,
        default=Path(os.environ.get("STEREO_GPU_DATA", ROOT.parent / "shared" / "data")),
        help="folder that holds stereo/teddy, stereo/tsukuba and stereo/motorcycle; by default STEREO_GPU_DATA",
    )
    parser.add_argument("--backend", help="where to compute, as `stereo-gpu devices` names it")
    options = parser.parse_args()
    folder = options.data / "stereo"
    missing = [name for name in (*GRADED, "motorcycle") if not (folder / name).is_dir()]
    if missing:
        print(f"{folder} holds no {', '.join(missing)}: set STEREO_GPU_DATA", file=sys.stderr)
        return 1
    for name in GRADED:
        for line in graded(folder, name, options.backend):
            print(line, flush=True)
        print()
    for line in motorcycle(folder, options.backend):
        print(line, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
