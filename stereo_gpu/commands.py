"""What each subcommand does. Only this module and cli.py print; stages are imported when a command needs them."""

from __future__ import annotations

import argparse
import glob
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from stereo_gpu.errors import InputError, StereoError
from stereo_gpu.progress import Progress

if TYPE_CHECKING:
    from stereo_gpu.types import Bytes

PICTURES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".ppm", ".pgm", ".webp"}


def demo(options: argparse.Namespace) -> None:
    """Render the built-in scene, reconstruct it and print the errors."""
    from stereo_gpu.demo import run_demo

    for line in run_demo(options.out, backend=options.backend):
        print(line, flush=True)


def capture(options: argparse.Namespace) -> None:
    """Take pairs of pictures."""
    from stereo_gpu.capture import capture

    for taken in capture(options.left, options.right, options.out, count=options.count, interval=options.interval):
        print(f"pair {taken.number}: {taken.left.name}, {taken.right.name}, skew {taken.skew_ms:.1f} ms", flush=True)


def calibrate(options: argparse.Namespace) -> None:
    """Calibrate two cameras and write the rig."""
    from stereo_gpu.board import Board
    from stereo_gpu.calibrate import calibrate
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


def rectify(options: argparse.Namespace) -> None:
    """Rectify a raw pair and write both pictures."""
    from stereo_gpu.check import check_rectified, refuse_swapped
    from stereo_gpu.files import check_writable, whole_folder
    from stereo_gpu.images import read_image, write_png
    from stereo_gpu.rectify import rectify
    from stereo_gpu.rig import Rig

    rig, left, right = Rig.load(options.rig), read_image(options.left), read_image(options.right)
    check_writable(options.out)
    pair = rectify(left, right, rig, backend=options.backend)
    found = check_rectified(pair.left, pair.right, offset_px=pair.cx_left - pair.cx_right)
    refuse_swapped(found)
    with whole_folder(options.out) as new:
        for name, picture in (("left", pair.left), ("right", pair.right)):
            write_png(new / f"{name}.png", picture)
    vertical = "not measured" if math.isnan(found.vertical_px) else f"{found.vertical_px:.2f} px"
    print(
        f"{options.out}: left.png and right.png, focal length {pair.focal_px:.2f} px, baseline {pair.baseline:.2f}"
        f" {pair.unit}, vertical error {vertical} (median of {found.matches} features)"
    )


def match(options: argparse.Namespace) -> None:
    """Match a rectified pair and write its disparities."""
    from stereo_gpu.check import check_rectified, refuse_swapped
    from stereo_gpu.export import write_pfm
    from stereo_gpu.figures import colour_disparity
    from stereo_gpu.files import check_writable, whole_folder
    from stereo_gpu.images import check_pair, read_image, write_png
    from stereo_gpu.match import match

    left, right = read_image(options.left), read_image(options.right)
    check_pair(left, right)
    mask = _read_mask(options.mask, left.shape[:2])
    check_writable(options.out)
    if options.disparities == "auto" or options.disparities[0] >= 0:
        # Whoever asks for negative disparities knows what the pair is like.
        refuse_swapped(check_rectified(left, right))
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
    searched = f"{disparity.smallest} to {disparity.smallest + disparity.disparities - 1}"
    print(
        f"{options.out}: disparity.pfm and disparity.png, {disparity.coverage:.1%} of the pixels have a value,"
        f" searched {searched} px in {sum(disparity.seconds.values()):.2f} s on {disparity.backend}"
    )


def reconstruct(options: argparse.Namespace) -> None:
    """Reconstruct a raw pair and write everything."""
    from stereo_gpu.config import MeshOptions
    from stereo_gpu.files import check_writable
    from stereo_gpu.images import check_pair, read_image
    from stereo_gpu.pipeline import STAGES, reconstruct
    from stereo_gpu.rectify import check_rig
    from stereo_gpu.rig import Rig

    rig, left, right = Rig.load(options.rig), read_image(options.left), read_image(options.right)
    check_pair(left, right)
    check_rig(left, rig)
    mask = _read_mask(options.mask, left.shape[:2])
    check_writable(options.out)
    with Progress([*STAGES, "save"]) as progress:
        result = reconstruct(
            options.left,
            options.right,
            rig,
            profile=options.profile,
            disparities=options.disparities,
            mask=mask,
            backend=options.backend,
            window=options.window,
            reference=options.reference,
            rectangle=options.rectangle,
            depth=options.depth,
            mesh=MeshOptions(faces=options.faces, smoothing=options.smoothing, unwrap=options.unwrap),
            tile=options.tile,
            progress=progress.step,
        )
        progress.step("save")
        result.save(options.out)
    for warning in result.warnings:
        print(f"stereo-gpu: warning: {warning}", file=sys.stderr)
    print(
        f"{options.out}: model.glb with {len(result.mesh.faces)} triangles in {sum(result.seconds.values()):.1f} s on"
        f" {result.disparity.backend}; open {options.out / 'report.html'}"
    )


def devices(options: argparse.Namespace) -> None:
    """Print what can compute here."""
    from stereo_gpu.backends import devices

    for status in devices():
        state = "ready" if status.available else f"not usable: {status.reason}; mend: {status.remedy}"
        print(f"{status.name:<32} {status.kind}  {status.label}: {state}")


def doctor(options: argparse.Namespace) -> None:
    """Print what is well and what is not; raise if nothing can compute."""
    from stereo_gpu.doctor import examine

    healthy = True
    for finding in examine():
        healthy = healthy and (finding.good or not finding.needed)
        print(f"{'ok  ' if finding.good else 'FAIL' if finding.needed else 'no  '}  {finding.what}: {finding.detail}")
        if finding.remedy:
            print(f"      mend: {finding.remedy}")
    if not healthy:
        raise StereoError("something that every reconstruction needs is broken: see the lines marked FAIL")


def bench(options: argparse.Namespace) -> None:
    """Print times beside those of OpenCV, keep them, compare them with older ones, and draw them."""
    from functools import partial

    from stereo_gpu.bench import SIZES, BenchOptions, check_bench_options, run_bench
    from stereo_gpu.bench.compare import check_limit, compare, comparison_lines
    from stereo_gpu.bench.record import BenchRun
    from stereo_gpu.bench.report import report_lines
    from stereo_gpu.files import check_writable, check_writable_file

    wanted = BenchOptions(
        sizes=tuple(options.size or SIZES),
        window=options.window,
        backends=tuple(options.backend or ()),
        only=tuple(options.only),
        seconds=options.seconds,
        cap=options.cap,
    )
    # Nothing may turn out to be wrong after half an hour.
    check_bench_options(wanted)
    check_limit(options.limit)
    old = BenchRun.load(options.compare) if options.compare else None
    if options.json:
        check_writable_file(options.json)
    if options.plot:
        from stereo_gpu.bench.plot import check_plotting, write_plots

        check_plotting()
        check_writable(options.plot)
    say = partial(print, flush=True)
    if options.load:
        run = BenchRun.load(options.load)
        for line in report_lines(run):
            say(line)
    else:
        run = run_bench(wanted, say)
    if options.json:
        run.save(options.json)
    if options.plot:
        for path in write_plots(run, options.plot):
            say(f"wrote {path}")
    if old:
        found = compare(old, run, options.limit)
        for line in comparison_lines(found):
            say(line)
        complaints = []
        if found.slower:
            names = ", ".join(dict.fromkeys(change.row.name for change in found.slower))
            complaints.append(
                f"{len(found.slower)} of {len(found.changes)} cases are over {options.limit:g} times slower than in"
                f" {options.compare}: {names}; run again on a quiet machine to be sure"
            )
        if found.stopped:
            reasons = "; ".join(dict.fromkeys(f"{row.name} ({row.note or 'no reason given'})" for row in found.stopped))
            complaints.append(f"{len(found.stopped)} cases that ran in {options.compare} run no more: {reasons}")
        if complaints:
            raise StereoError("; ".join(complaints))


def split_pictures(given: Sequence[str]) -> tuple[list[Path], list[Path]]:
    """Tell left pictures from right ones: two folders, two patterns, or one list whose first half is left.

    Raises:
        InputError: a folder or pattern holds no picture, or the list has an odd length.
    """
    if len(given) == 2:
        return _expand(given[0]), _expand(given[1])
    if len(given) % 2:
        raise InputError(f"{len(given)} pictures cannot be pairs: give all left ones, then as many right ones")
    half = len(given) // 2
    return [Path(name) for name in given[:half]], [Path(name) for name in given[half:]]


def _expand(name: str) -> list[Path]:
    path = Path(name)
    if path.is_dir():
        found = sorted(file for file in path.iterdir() if file.suffix.lower() in PICTURES)
        if not found:
            raise InputError(f"folder {name} holds no picture: it needs files such as left01.png")
        return found
    if any(sign in name for sign in "*?["):
        found = sorted(Path(match) for match in glob.glob(name))  # noqa: PTH207 - takes absolute patterns too
        if not found:
            raise InputError(f"no picture matches {name}: check the pattern and the folder")
        return found
    return [path]


def _read_mask(path: Path | None, shape: tuple[int, ...]) -> Bytes | None:
    from stereo_gpu.mask import mask_from_file

    return None if path is None else mask_from_file(path, (shape[1], shape[0]))
