"""Find the geometry of two cameras from pictures of a checkerboard."""

from __future__ import annotations

import argparse
from pathlib import Path

from stereo_gpu.commands.pictures import split_pictures
from stereo_gpu.progress import Progress


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what the command takes."""
    parser.add_argument(
        "pictures",
        nargs="+",
        metavar="LEFT... RIGHT...",
        help="all left pictures and then all right ones; or two folders; or two quoted patterns",
    )
    parser.add_argument("--board", required=True, metavar="10x7", help="squares of the board, columns x rows")
    parser.add_argument("--square", type=float, required=True, help="side of a square, mm")
    parser.add_argument("--coefficients", type=int, choices=(5, 8, 12), default=5, help="of the lens model")
    parser.add_argument("--out", type=Path, required=True, metavar="rig.json", help="the file to write")


def run(options: argparse.Namespace) -> None:
    """Calibrate two cameras and write the rig."""
    from stereo_gpu.calibrate import calibrate
    from stereo_gpu.calibration.board import Board
    from stereo_gpu.files import check_writable_file

    board = Board.parse(options.board, options.square)
    left, right = split_pictures(options.pictures)
    check_writable_file(options.out)
    with Progress() as progress:
        rig = calibrate(left, right, board, coefficients=options.coefficients, progress=progress.searched)
    rig.save(options.out)
    for view in rig.views:
        if not view.used:
            print(f"left out {view.left}, {view.right}: {view.reason}")
    used = sum(view.used for view in rig.views)
    print(
        f"{options.out}: {used} of {len(rig.views)} pairs, reprojection error {rig.rms_px:.3f} px,"
        f" epipolar error {rig.epipolar_rms_px:.3f} px, baseline {rig.baseline:.2f} {rig.unit}"
    )
