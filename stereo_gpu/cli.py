"""The command line: `stereo-gpu`. It alone prints and exits; every error is one line."""

from __future__ import annotations

import argparse
import glob
import io
import logging
import math
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from stereo_gpu.errors import InputError, StereoError

if TYPE_CHECKING:
    from stereo_gpu.types import Bytes

CLEAR_LINE = "\r\x1b[K"  # to the start of the line, and erase it
BAR_WIDTH = 24
LINES = 10  # that a search prints where no bar can be drawn
PICTURES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".ppm", ".pgm", ".webp"}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand; returns the exit status: 0, 2 for wrong input, 1 for any other failure."""
    try:
        options = _parser().parse_args(arguments)
    except SystemExit as done:  # help, version, or an argument that is wrong
        return int(done.code or 0)
    if isinstance(sys.stdout, io.TextIOWrapper):
        # Files may have names that the terminal's encoding cannot show.
        sys.stdout.reconfigure(errors="backslashreplace")
    with _messages(options.debug):
        return _run(options)


def _run(options: argparse.Namespace) -> int:
    try:
        options.run(options)
        sys.stdout.flush()
    except KeyboardInterrupt:
        return _fail("interrupted; nothing was left half written", 130)
    except BrokenPipeError:
        # Whoever read our output has had enough, as `stereo-gpu devices | head -1` does; what is still buffered
        # must not fail again when Python ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except StereoError as error:
        if options.debug:
            raise
        return _fail(str(error), 2 if isinstance(error, InputError) else 1)
    except Exception as error:
        if options.debug:
            raise
        return _fail(f"{type(error).__name__}: {error} (this is a fault of ours: run again with --debug)", 1)
    return 0


class _Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line too."""

    def error(self, message: str) -> NoReturn:
        if message.endswith("expected one argument"):
            message += " (a value that begins with a minus needs an equals sign before it, as --disparities=-8,64)"
        self.exit(_fail(f"{message}; see {self.prog} --help", 2))


class _OneLine(logging.Formatter):
    """Messages as one line each, over a progress bar where one is drawn."""

    def format(self, record: logging.LogRecord) -> str:
        clear = CLEAR_LINE if sys.stderr.isatty() else ""
        return f"{clear}stereo-gpu: {record.levelname.lower()}: {record.getMessage()}"


@contextmanager
def _messages(debug: bool) -> Iterator[None]:
    """Show what the library logs: warnings, or everything."""
    handler = logging.StreamHandler()
    handler.setFormatter(_OneLine())
    own = logging.getLogger("stereo_gpu")
    before = own.level
    own.addHandler(handler)
    own.setLevel(logging.DEBUG if debug else logging.WARNING)
    try:
        yield
    finally:
        own.removeHandler(handler)
        own.setLevel(before)


def _fail(message: str, status: int) -> int:
    print("stereo-gpu: error: " + " ".join(message.split()), file=sys.stderr)
    return status


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="stereo-gpu", description="Two cameras in, a textured metric 3-D model out.")
    parser.add_argument("--version", action="version", version=_version())
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def command(name: str, run: Callable[[argparse.Namespace], None], text: str) -> argparse.ArgumentParser:
        added = commands.add_parser(name, help=text, description=text)
        added.set_defaults(run=run)
        added.add_argument("--debug", action="store_true", help="show a traceback and all messages")
        return added

    demo = command("demo", _demo, "render a scene with known truth, reconstruct it and measure the error")
    demo.add_argument("--out", type=Path, default=Path("demo-out"), help="folder for the results (%(default)s)")
    _backend(demo)

    capture = command("capture", _capture, "take pairs of pictures with two cameras")
    capture.add_argument("left", help="number, device path, or video file of the left camera")
    capture.add_argument("right", help="the same of the right camera")
    capture.add_argument("--out", type=Path, required=True, help="folder for left0001.png, right0001.png, ...")
    capture.add_argument("--count", type=int, default=15, help="how many pairs to take (%(default)s)")
    capture.add_argument("--interval", type=float, default=2.0, help="seconds between pairs (%(default)s)")

    calibrate = command("calibrate", _calibrate, "find the geometry of two cameras from pictures of a checkerboard")
    calibrate.add_argument(
        "pictures",
        nargs="+",
        metavar="LEFT... RIGHT...",
        help="all left pictures and then all right ones; or two folders; or two quoted patterns",
    )
    calibrate.add_argument("--board", required=True, metavar="10x7", help="squares of the board, columns x rows")
    calibrate.add_argument("--square", type=float, required=True, help="side of a square, mm")
    calibrate.add_argument("--coefficients", type=int, choices=(5, 8, 12), default=5, help="of the lens model")
    calibrate.add_argument("--out", type=Path, required=True, metavar="rig.json", help="the file to write")

    rectify = command("rectify", _rectify, "undistort a raw pair and make its rows correspond")
    _pair(rectify)
    _rig(rectify)
    rectify.add_argument("--out", type=Path, required=True, help="folder for left.png and right.png")
    _backend(rectify)

    match = command("match", _match, "find the disparities of a rectified pair")
    _pair(match)
    _matching(match, "fast")
    match.add_argument("--mask", type=Path, help="picture, black where the reference view is not wanted")
    match.add_argument("--out", type=Path, required=True, help="folder for disparity.pfm and disparity.png")
    _backend(match)

    reconstruct = command("reconstruct", _reconstruct, "make a textured model of a raw pair")
    _pair(reconstruct)
    _rig(reconstruct)
    reconstruct.add_argument("--out", type=Path, required=True, help="folder for the model and the report")
    _matching(reconstruct, "precise")
    reconstruct.add_argument(
        "--mask", type=Path, help="picture, black where the rectified reference view is not wanted"
    )
    reconstruct.add_argument(
        "--rectangle", type=_numbers(int, 4), metavar="X,Y,W,H", help="box around the object; GrabCut finds its outline"
    )
    reconstruct.add_argument(
        "--depth", type=_numbers(float, 2), metavar="NEAR,FAR", help="wanted depths, in the rig's unit"
    )
    reconstruct.add_argument("--faces", type=int, default=50_000, help="triangles of the mesh; 0: all (%(default)s)")
    reconstruct.add_argument("--smoothing", type=int, default=10, help="passes of smoothing; 0: none (%(default)s)")
    reconstruct.add_argument(
        "--unwrap", choices=("charts", "view"), default="charts", help="texture coordinates (%(default)s)"
    )
    _backend(reconstruct)

    command("devices", _devices, "list what can compute here")
    command("doctor", _doctor, "check the installation and every device, and say what would mend the rest")

    bench = command("bench", _bench, "time the kernels and OpenCV's block matcher in the same run")
    bench.add_argument("--size", type=_numbers(int, 3), default=(1280, 960, 128), metavar="W,H,D", help="of the pair")
    bench.add_argument("--window", type=int, default=11, help="side of the window, px (%(default)s)")
    _backend(bench)
    return parser


def _pair(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("left", type=Path, help="the left camera's picture")
    parser.add_argument("right", type=Path, help="the right camera's picture")


def _rig(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--rig", type=Path, required=True, metavar="rig.json", help="what `calibrate` wrote")


def _backend(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--backend", help="where to compute, as `devices` names it; by default the best device")


def _matching(parser: argparse.ArgumentParser, profile: str) -> None:
    parser.add_argument("--profile", default=profile, help="paper, fast or precise (%(default)s)")
    parser.add_argument(
        "--disparities",
        type=_range,
        default="auto",
        metavar="SMALLEST,COUNT",
        help="range to search, px, for example 0,64 or --disparities=-8,64; or auto (%(default)s)",
    )
    parser.add_argument("--window", type=int, help="side of the window, px, odd, 3 to 31; by default the profile's")
    parser.add_argument("--reference", default="right", help="view that the result is laid out on (%(default)s)")


def _numbers(kind: type, count: int) -> Callable[[str], tuple[float, ...]]:
    def parse(text: str) -> tuple[float, ...]:
        try:
            found = tuple(kind(part) for part in text.split(","))
        except ValueError:
            found = ()
        if len(found) != count:
            raise argparse.ArgumentTypeError(f"{text!r}: give {count} numbers with commas between them")
        return found

    return parse


def _range(text: str) -> object:
    return "auto" if text == "auto" else _numbers(int, 2)(text)


def _demo(options: argparse.Namespace) -> None:
    from stereo_gpu.demo import run_demo

    for line in run_demo(options.out, backend=options.backend):
        print(line, flush=True)


def _capture(options: argparse.Namespace) -> None:
    from stereo_gpu.capture import capture

    for taken in capture(options.left, options.right, options.out, count=options.count, interval=options.interval):
        print(f"pair {taken.number}: {taken.left.name}, {taken.right.name}, skew {taken.skew_ms:.1f} ms", flush=True)


def _calibrate(options: argparse.Namespace) -> None:
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


def _rectify(options: argparse.Namespace) -> None:
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


def _match(options: argparse.Namespace) -> None:
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


def _reconstruct(options: argparse.Namespace) -> None:
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


def _devices(options: argparse.Namespace) -> None:
    from stereo_gpu.backends import devices

    for status in devices():
        state = "ready" if status.available else f"not usable: {status.reason}; mend: {status.remedy}"
        print(f"{status.name:<32} {status.kind}  {status.label}: {state}")


def _doctor(options: argparse.Namespace) -> None:
    from stereo_gpu.doctor import examine

    healthy = True
    for finding in examine():
        healthy = healthy and (finding.good or not finding.needed)
        print(f"{'ok  ' if finding.good else 'FAIL' if finding.needed else 'no  '}  {finding.what}: {finding.detail}")
        if finding.remedy:
            print(f"      mend: {finding.remedy}")
    if not healthy:
        raise StereoError("something that every reconstruction needs is broken: see the lines marked FAIL")


def _bench(options: argparse.Namespace) -> None:
    from stereo_gpu.bench import run_bench

    for line in run_bench(*options.size, window=options.window, backend=options.backend):
        print(line, flush=True)


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


class Progress:
    """A bar that is redrawn on a terminal, plain lines elsewhere; both on standard error."""

    def __init__(self, stages: Sequence[str] = ()) -> None:
        self._stages = list(stages)
        self._drawn = sys.stderr.isatty()

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        if self._drawn:
            print(CLEAR_LINE, end="", file=sys.stderr, flush=True)

    def step(self, name: str) -> None:
        """Say that the stage of this name begins."""
        if self._drawn:
            self._draw(self._stages.index(name), len(self._stages), name)
        else:
            print(f"stereo-gpu: {name}", file=sys.stderr, flush=True)

    def searched(self, done: int, total: int) -> None:
        """Say how many of the pictures have been searched for the board."""
        text = f"{done} of {total} pictures searched"
        if self._drawn:
            self._draw(done, total, text)
        elif done == total or done * LINES // total > (done - 1) * LINES // total:
            print(f"stereo-gpu: {text}", file=sys.stderr, flush=True)

    def _draw(self, done: int, total: int, text: str) -> None:
        full = BAR_WIDTH * done // total
        bar = "#" * full + "." * (BAR_WIDTH - full)
        print(f"{CLEAR_LINE}[{bar}] {text}", end="", file=sys.stderr, flush=True)


def _version() -> str:
    from importlib.metadata import version

    return f"stereo-gpu {version('stereo-gpu')}"
