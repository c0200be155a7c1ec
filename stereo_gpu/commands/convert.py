"""Turn a calibration file of one program into that of another."""

from __future__ import annotations

import argparse
import re
from pathlib import Path


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what the command takes."""
    parser.add_argument(
        "calibration",
        type=Path,
        nargs="+",
        metavar="IN",
        help="OpenCV's, ROS's, the Matlab toolbox's, Middlebury's or KITTI's file, or ours; for ROS the left and the"
        " right one, or their folder; for OpenCV also intrinsics and extrinsics",
    )
    parser.add_argument("--out", type=Path, required=True, help="file to write; for ROS a folder")
    parser.add_argument(
        "--format", metavar="NAME", help="json, yaml or xml (OpenCV), mat (Matlab) or ros; by default the suffix's"
    )
    parser.add_argument(
        "--size", type=_size, metavar="640x480", help="size of the pictures, px, where the file does not say"
    )
    parser.add_argument("--unit", help="of the rig's lengths: mm, cm, m or in; by default the file's, or mm")
    parser.add_argument(
        "--cameras", type=_cameras, metavar="2,3", help="KITTI's numbers of the left and the right camera"
    )


def run(options: argparse.Namespace) -> None:
    """Read a rig, write it, and say what it is."""
    from stereo_gpu.rig_files.load import load_rig
    from stereo_gpu.rig_files.save import check_format, save_rig

    kind = check_format(options.out, options.format)
    rig = load_rig(*options.calibration, size=options.size, unit=options.unit, cameras=options.cameras)
    files = save_rig(rig, options.out, format=kind)
    width, height = rig.left.size
    print(
        f"{' and '.join(map(str, files))}: pictures of {width} x {height} px, {len(rig.left.distortion)} lens"
        f" coefficients, baseline {rig.baseline:.6g} {rig.unit}"
    )


def _size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d{1,6})x(\d{1,6})", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r}: give width x height in px, such as 640x480")
    return int(match[1]), int(match[2])


def _cameras(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d),(\d)", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r}: give two numbers, such as 2,3")
    return int(match[1]), int(match[2])
