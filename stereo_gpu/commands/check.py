"""Say whether a rig still fits a raw pair, and correct a small drift.

The exit status is 1 where the rig does not fit: rows over 2 px apart, or nearly all points behind the cameras.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from stereo_gpu.commands.arguments import add_pair, add_rig
from stereo_gpu.errors import InputError, StereoError


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what the command takes."""
    add_pair(parser)
    add_rig(parser)
    parser.add_argument("--out", type=Path, help="folder for check.png, a map of the errors, and check.json")
    parser.add_argument("--refine", action="store_true", help="correct a small drift of the cameras from the pair")
    parser.add_argument("--save", type=Path, metavar="new.json", help="with --refine: the file for the corrected rig")


def run(options: argparse.Namespace) -> None:
    """Print what the pair says of the rig; write the map and the corrected rig where they are wanted."""
    from stereo_gpu.check_figure import draw_check
    from stereo_gpu.files import check_writable, whole_folder, write_whole
    from stereo_gpu.images import check_pair, read_image, write_png
    from stereo_gpu.refine_rig import refine_rig
    from stereo_gpu.rig_check import RigCheck, Verdict, check_rig
    from stereo_gpu.rig_files.load import load_rig_for
    from stereo_gpu.rig_files.save import check_format, save_rig

    if options.save and not options.refine:
        raise InputError(f"--save {options.save}: only a corrected rig is saved, give --refine as well")
    left, right = read_image(options.left), read_image(options.right)
    check_pair(left, right)
    rig = load_rig_for(options.rig, left)
    if options.out:
        check_writable(options.out)
    if options.save:
        check_format(options.save, None)
    checked: RigCheck = check_rig(left, right, rig)
    print(f"{checked.verdict}: {checked.says}", flush=True)
    if checked.verdict is not Verdict.UNKNOWN:
        print(
            f"{len(checked.vertical)} of {checked.matches} matched features agree, in {checked.map.share:.0%} of the"
            f" frame's cells: 95 % within {checked.vertical_95_px:.2f} px, middle {checked.bias_px:+.2f} px (row in the"
            " left picture less row in the right one)",
            flush=True,
        )
    record = checked.record()
    refined = refused = None
    if options.refine:
        try:
            refined = refine_rig(left, right, rig, checked=checked)
        except InputError as error:
            refused = error  # the map is written all the same
        else:
            print(f"refined: {refined.says}" if refined.changed else f"not refined: {refined.says}", flush=True)
            record["refinement"] = refined.record()
    if options.out:
        with whole_folder(options.out) as new:
            write_png(new / "check.png", draw_check(left, checked))
            write_whole(new / "check.json", json.dumps(record, indent=1, allow_nan=False) + "\n")
        print(f"{options.out}: check.png and check.json")
    if refused is not None:
        raise refused
    if refined is not None and options.save:
        save_rig(refined.rig, options.save)
        print(f"{options.save}: the {'corrected' if refined.changed else 'same'} rig")
    elif refined is not None and refined.changed:
        print("the corrected rig is not kept: give --save new.json")
    if checked.verdict is Verdict.BAD and not (refined and refined.changed):
        raise StereoError(f"the rig does not fit this pair: {checked.says}")
