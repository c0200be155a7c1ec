"""Find the disparities of a rectified pair."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from stereo_gpu.commands.arguments import add_backend, add_matching, add_pair
from stereo_gpu.commands.pictures import read_mask


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what the command takes."""
    add_pair(parser)
    add_matching(parser, "fast")
    parser.add_argument("--mask", type=Path, help="picture, black where the reference view is not wanted")
    parser.add_argument("--out", type=Path, required=True, help="folder for disparity.pfm and disparity.png")
    add_backend(parser)


def run(options: argparse.Namespace) -> None:
    """Match a rectified pair and write its disparities."""
    from stereo_gpu.check import check_rectified, refuse_swapped
    from stereo_gpu.export import write_pfm
    from stereo_gpu.figures import colour_disparity
    from stereo_gpu.files import check_writable, whole_folder
    from stereo_gpu.images import check_pair, read_image, write_png
    from stereo_gpu.match import match
    from stereo_gpu.rig_check import WARN_PX

    left, right = read_image(options.left), read_image(options.right)
    check_pair(left, right)
    mask = read_mask(options.mask, left.shape[:2])
    check_writable(options.out)
    checked = check_rectified(left, right)
    if options.disparities == "auto" or options.disparities[0] >= 0:
        # Whoever asks for negative disparities knows what the pair is like.
        refuse_swapped(checked)
    disparity = match(
        left,
        right,
        disparities=options.disparities,
        window=options.window,
        reference=options.reference,
        profile=options.profile,
        mask=mask,
        tile=options.tile,
        backend=options.backend,
    )
    with whole_folder(options.out) as new:
        write_pfm(new / "disparity.pfm", disparity.values)
        write_png(new / "disparity.png", colour_disparity(disparity.values, bar=True))
    if checked.vertical_px > WARN_PX:
        print(
            f"stereo-gpu: warning: rows differ by {checked.vertical_px:.2f} px (median of matched features): match"
            " takes a rectified pair, see `stereo-gpu rectify`",
            file=sys.stderr,
        )
    searched = f"{disparity.smallest} to {disparity.smallest + disparity.disparities - 1}"
    print(
        f"{options.out}: disparity.pfm and disparity.png, {disparity.coverage:.1%} of the pixels have a value,"
        f" searched {searched} px in {sum(disparity.seconds.values()):.2f} s on {disparity.backend}"
    )
