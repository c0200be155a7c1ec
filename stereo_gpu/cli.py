"""The command line: `stereo-gpu`. What it understands; every error is one line."""

from __future__ import annotations

import argparse
import io
import logging
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

from stereo_gpu import commands
from stereo_gpu.errors import InputError, StereoError
from stereo_gpu.progress import CLEAR_LINE


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
    subparsers = parser.add_subparsers(required=True, metavar="COMMAND")

    def command(name: str, run: Callable[[argparse.Namespace], None], text: str) -> argparse.ArgumentParser:
        added = subparsers.add_parser(name, help=text, description=text)
        added.set_defaults(run=run)
        added.add_argument("--debug", action="store_true", help="show a traceback and all messages")
        return added

    demo = command("demo", commands.demo, "render a scene with known truth, reconstruct it and measure the error")
    demo.add_argument("--out", type=Path, default=Path("demo-out"), help="folder for the results (%(default)s)")
    _backend(demo)

    capture = command("capture", commands.capture, "take pairs of pictures with two cameras")
    capture.add_argument("left", help="number, device path, or video file of the left camera")
    capture.add_argument("right", help="the same of the right camera")
    capture.add_argument("--out", type=Path, required=True, help="folder for left0001.png, right0001.png, ...")
    capture.add_argument("--count", type=int, default=15, help="how many pairs to take (%(default)s)")
    capture.add_argument("--interval", type=float, default=2.0, help="seconds between pairs (%(default)s)")

    calibrate = command(
        "calibrate", commands.calibrate, "find the geometry of two cameras from pictures of a checkerboard"
    )
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

    rectify = command("rectify", commands.rectify, "undistort a raw pair and make its rows correspond")
    _pair(rectify)
    _rig(rectify)
    rectify.add_argument("--out", type=Path, required=True, help="folder for left.png and right.png")
    _backend(rectify)

    match = command("match", commands.match, "find the disparities of a rectified pair")
    _pair(match)
    _matching(match, "fast")
    match.add_argument("--mask", type=Path, help="picture, black where the reference view is not wanted")
    match.add_argument("--out", type=Path, required=True, help="folder for disparity.pfm and disparity.png")
    _backend(match)

    reconstruct = command("reconstruct", commands.reconstruct, "make a textured model of a raw pair")
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

    command("devices", commands.devices, "list what can compute here")
    command("doctor", commands.doctor, "check the installation and every device, and say what would mend the rest")

    bench = command("bench", commands.bench, "time every kernel and profile, and OpenCV's functions in turn with them")
    bench.add_argument(
        "--size",
        type=_numbers(int, 3),
        action="append",
        metavar="W,H,D",
        help="width, height and disparities; may be given more than once (640,480,64 1280,960,128 2560,1920,256)",
    )
    bench.add_argument("--window", type=int, default=11, help="side of the window, px (%(default)s)")
    bench.add_argument(
        "--backend", action="append", help="where to compute, as `devices` names it; more than once; default: all"
    )
    bench.add_argument("--only", nargs="+", default=[], metavar="NAME", help="kernels, profiles or OpenCV's matchers")
    bench.add_argument("--seconds", type=float, default=5.0, help="to time each thing at least (%(default)s)")
    bench.add_argument("--cap", type=float, default=60.0, help="seconds to time each thing at most (%(default)s)")
    bench.add_argument("--json", type=Path, metavar="FILE", help="write the run to this file")
    bench.add_argument("--load", type=Path, metavar="FILE", help="take such a file instead of timing anything")
    bench.add_argument("--compare", type=Path, metavar="OLD.json", help="tell what got slower; exit 1 past the limit")
    bench.add_argument(
        "--limit", type=float, default=1.15, help="how many times slower a case may have become (%(default)s)"
    )
    bench.add_argument("--plot", type=Path, metavar="DIR", help="folder for a roofline, bar charts and a page")
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
    parser.add_argument(
        "--window",
        type=_window,
        metavar="PX",
        help="side of the window, px, odd, 3 to 31, or auto: chosen for each pixel; by default the profile's",
    )
    parser.add_argument("--reference", default="right", help="view that the result is laid out on (%(default)s)")
    parser.add_argument(
        "--tile", type=int, metavar="PX", help="largest side of the parts to match in; by default what fits the memory"
    )


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


def _window(text: str) -> object:
    if text == "auto":
        return text
    try:
        return int(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r}: give the side of a square in px, or auto") from error


def _version() -> str:
    from importlib.metadata import version

    return f"stereo-gpu {version('stereo-gpu')}"
