"""Make a textured model of a raw pair."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from stereo_gpu.commands.arguments import (
    add_backend,
    add_matching,
    add_model,
    add_pair,
    add_rig,
    add_texture_format,
    numbers,
    read_mesh_options,
)
from stereo_gpu.commands.pictures import read_mask
from stereo_gpu.progress import Progress


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what the command takes."""
    add_pair(parser)
    add_rig(parser, required=False)
    alone = parser.add_argument_group("without a rig")
    alone.add_argument("--focal", type=float, metavar="PX", help="focal length, px; by default EXIF's, or a guess")
    alone.add_argument("--baseline", type=float, metavar="MM", help="distance between the cameras: sets the scale")
    alone.add_argument(
        "--distance",
        type=numbers(float, 5),
        metavar="X1,Y1,X2,Y2,MM",
        help="two places in the raw reference picture, px, and how far they are apart: sets the scale",
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for the model and the report")
    add_matching(parser, "precise")
    parser.add_argument("--mask", type=Path, help="picture, black where the rectified reference view is not wanted")
    parser.add_argument(
        "--rectangle", type=numbers(int, 4), metavar="X,Y,W,H", help="box around the object; GrabCut finds its outline"
    )
    parser.add_argument("--depth", type=numbers(float, 2), metavar="NEAR,FAR", help="wanted depths, in the rig's unit")
    add_model(parser)
    add_texture_format(parser)
    parser.add_argument(
        "--ignore-check",
        action="store_true",
        help="go on where the rig does not fit the pair, or the two look swapped",
    )
    add_backend(parser)


def run(options: argparse.Namespace) -> None:
    """Reconstruct a raw pair and write everything."""
    from stereo_gpu.files import check_writable
    from stereo_gpu.images import check_pair, read_image
    from stereo_gpu.known_distance import KnownDistance
    from stereo_gpu.pipeline import STAGES, reconstruct
    from stereo_gpu.rectify import check_sizes
    from stereo_gpu.rig_files.load import load_rig_for

    left, right = read_image(options.left), read_image(options.right)
    check_pair(left, right)
    rig = None if options.rig is None else load_rig_for(options.rig, left)
    if rig is not None:
        check_sizes(left, rig)
    x1, y1, x2, y2, length = options.distance or [0.0] * 5
    distance = KnownDistance((x1, y1), (x2, y2), length) if options.distance else None
    mask = read_mask(options.mask, left.shape[:2])
    check_writable(options.out)
    with Progress([*STAGES, "save"]) as progress:
        result = reconstruct(
            options.left,
            options.right,
            rig,
            focal_px=options.focal,
            baseline=options.baseline,
            distance=distance,
            profile=options.profile,
            disparities=options.disparities,
            mask=mask,
            backend=options.backend,
            window=options.window,
            reference=options.reference,
            rectangle=options.rectangle,
            depth=options.depth,
            mesh=read_mesh_options(options),
            tile=options.tile,
            ignore_check=options.ignore_check,
            progress=progress.step,
        )
        progress.step("save")
        result.save(options.out, texture_format=options.texture_format)
    for warning in result.warnings:
        print(f"stereo-gpu: warning: {warning}", file=sys.stderr)
    print(
        f"{options.out}: model.glb with {len(result.mesh.faces)} triangles in {sum(result.seconds.values()):.1f} s on"
        f" {result.disparity.backend}; open {options.out / 'report.html'}"
    )
