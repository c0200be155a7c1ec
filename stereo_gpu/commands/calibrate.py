"""Find the geometry of two cameras from pictures of a board."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from stereo_gpu.commands.arguments import add_board, read_board
from stereo_gpu.commands.pictures import split_pictures
from stereo_gpu.errors import InputError
from stereo_gpu.progress import Progress


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what the command takes."""
    parser.add_argument(
        "pictures",
        nargs="+",
        metavar="LEFT... RIGHT...",
        help="all left pictures and then all right ones; or two folders; or two quoted patterns",
    )
    add_board(parser)
    parser.add_argument(
        "--coefficients",
        type=_coefficients,
        default="auto",
        metavar="5|8|12|auto",
        help="of the lens model; auto: the fewest that predict views left out as well as any number does (%(default)s)",
    )
    parser.add_argument("--pairs", type=_pairs, metavar="FIRST-LAST", help="use these pairs alone, counted from 1")
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="rig.json",
        help="file to write; .yml, .xml and .mat for other programs",
    )
    parser.add_argument("--report", type=Path, metavar="rig.html", help="page to write; by default beside the rig")
    parser.add_argument("--no-report", action="store_true", help="write no page")


def run(options: argparse.Namespace) -> None:
    """Calibrate two cameras, write the rig and the report, and print what is certain and what is not."""
    from stereo_gpu.calibrate import calibrate_in_full
    from stereo_gpu.calibration.report import write_calibration_report
    from stereo_gpu.calibration.table import calibration_table
    from stereo_gpu.files import check_writable_file
    from stereo_gpu.rig_files.save import check_format, save_rig

    board = read_board(options)
    left, right = _chosen(options.pairs, *split_pictures(options.pictures))
    check_format(options.out, None)
    report = None if options.no_report else options.report or options.out.with_suffix(".html")
    if report and report.resolve() == options.out.resolve():
        raise InputError(f"{report} cannot be both the rig and its report: name another file with --report")
    if report is not None:
        check_writable_file(report)
    with Progress() as progress:
        calibration = calibrate_in_full(
            left,
            right,
            board,
            coefficients=options.coefficients,
            progress=progress.searched,
            first_number=options.pairs[0] if options.pairs else 1,
        )
    rig = calibration.rig
    save_rig(rig, options.out)
    if report is not None:
        write_calibration_report(calibration, report)
    for view in rig.views:
        if not view.used:
            print(f"left out {view.left}, {view.right}: {view.reason}")
    used = sum(view.used for view in rig.views)
    print(
        f"{options.out}: {used} of {len(rig.views)} pairs, reprojection error {rig.rms_px:.3f} px,"
        f" epipolar error {rig.epipolar_rms_px:.3f} px, baseline {rig.baseline:.2f} {rig.unit}"
    )
    for line in (*calibration_table(calibration), *calibration.advice):
        print(line)
    if report is not None:
        print(f"{report}: the same with pictures")


def _chosen(pairs: tuple[int, int] | None, left: list[Path], right: list[Path]) -> tuple[list[Path], list[Path]]:
    if pairs is None or len(left) != len(right):  # the calibration refuses such lists, and says why
        return left, right
    first, last = pairs
    if last > len(left):
        raise InputError(f"--pairs {first}-{last}: there are {len(left)} pairs; end earlier")
    return left[first - 1 : last], right[first - 1 : last]


def _pairs(text: str) -> tuple[int, int]:
    parts = re.fullmatch(r"\s*(\d{1,6})\s*-\s*(\d{1,6})\s*", text, re.ASCII)
    if parts is None or not 1 <= int(parts[1]) <= int(parts[2]):
        raise argparse.ArgumentTypeError(f"{text!r:.60}: give the first and the last pair, such as 1-6")
    return int(parts[1]), int(parts[2])


def _coefficients(text: str) -> int | str:
    if text not in ("5", "8", "12", "auto"):
        raise argparse.ArgumentTypeError(f"{text!r:.60}: give 5, 8, 12 or auto")
    return text if text == "auto" else int(text)
