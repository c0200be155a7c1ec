"""Undistort a raw pair and make its rows correspond."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

from stereo_gpu.commands.arguments import add_backend, add_pair, add_rig


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what the command takes."""
    add_pair(parser)
    add_rig(parser)
    parser.add_argument("--out", type=Path, required=True, help="folder for left.png and right.png")
    add_backend(parser)


def run(options: argparse.Namespace) -> None:
    """Rectify a raw pair and write both pictures."""
    from stereo_gpu.files import check_writable, whole_folder
    from stereo_gpu.images import check_pair, read_image, write_png
    from stereo_gpu.rectify import rectify
    from stereo_gpu.rig_check import Verdict, check_rig, refuse_swapped
    from stereo_gpu.rig_files.load import load_rig_for

    left, right = read_image(options.left), read_image(options.right)
    check_pair(left, right)
    rig = load_rig_for(options.rig, left)
    check_writable(options.out)
    checked = check_rig(left, right, rig)
    refuse_swapped(checked)
    pair = rectify(left, right, rig, backend=options.backend)
    with whole_folder(options.out) as new:
        for name, picture in (("left", pair.left), ("right", pair.right)):
            write_png(new / f"{name}.png", picture)
    if checked.verdict is not Verdict.GOOD:
        print(f"stereo-gpu: warning: {checked.says}", file=sys.stderr)
    vertical = "not measured" if math.isnan(checked.vertical_px) else f"{checked.vertical_px:.2f} px"
    print(
        f"{options.out}: left.png and right.png, focal length {pair.focal_px:.2f} px, baseline {pair.baseline:.2f}"
        f" {pair.unit}, vertical error {vertical} (median of {len(checked.vertical)} features)"
    )
