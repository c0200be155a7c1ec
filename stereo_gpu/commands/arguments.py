"""What several commands take."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stereo_gpu.boards.board import Board
    from stereo_gpu.config import MeshOptions


def add_pair(parser: argparse.ArgumentParser) -> None:
    """Two pictures."""
    parser.add_argument("left", type=Path, help="the left camera's picture")
    parser.add_argument("right", type=Path, help="the right camera's picture")


def add_rig(parser: argparse.ArgumentParser, *, required: bool = True) -> None:
    """A rig's file."""
    without = "" if required else "; without one it is made from the pair, up to scale"
    parser.add_argument(
        "--rig",
        type=Path,
        required=required,
        metavar="rig.json",
        help="what `calibrate` wrote, or a calibration file of OpenCV, ROS (the folder), Matlab, Middlebury or KITTI"
        + without,
    )


def add_board(parser: argparse.ArgumentParser, *, required: bool = True) -> None:
    """A checkerboard or a ChArUco board; `read_board` makes it of the options.

    Args:
        parser: of the command.
        required: whether it must be named, with the side of its squares.
    """
    parser.add_argument("--board", required=required, metavar="10x7", help="squares of the board, columns x rows")
    parser.add_argument("--square", type=float, required=required, metavar="MM", help="side of a square, mm")
    parser.add_argument("--marker", type=float, metavar="MM", help="side of a marker, mm, if it is a ChArUco board")
    parser.add_argument("--dictionary", metavar="NAME", help="of the markers, such as 4x4_50 (5x5_250)")


def read_board(options: argparse.Namespace) -> Board:
    """The board that the options name; where they need not give its squares, these have a side of 1.

    Raises:
        InputError: there is no such board, or options for markers stand without their sides.
    """
    from stereo_gpu.boards.choose import choose_board

    return choose_board(options.board, options.square, options.marker, options.dictionary, dashes="--")


def add_backend(parser: argparse.ArgumentParser) -> None:
    """The device."""
    parser.add_argument("--backend", help="where to compute, as `devices` names it; by default the best device")


def add_engine(parser: argparse.ArgumentParser) -> None:
    """Where jobs are done."""
    parser.add_argument(
        "--engine",
        choices=("local", "ray"),
        default="local",
        help="in processes of this machine, or on the nodes of a Ray cluster (%(default)s)",
    )
    parser.add_argument(
        "--address",
        metavar="HOST:PORT",
        help="with --engine ray, the head of the cluster, of which this machine must be a node, or auto for the one"
        " that runs here; by default one is started here and ended again",
    )


def add_matching(parser: argparse.ArgumentParser, profile: str) -> None:
    """How to match; `profile` is the default one."""
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


def add_model(parser: argparse.ArgumentParser) -> None:
    """How the model is made of a disparity map; `read_mesh_options` reads it."""
    parser.add_argument(
        "--mesh", choices=("bounded", "dense"), default="bounded", help="few triangles, or two a pixel (%(default)s)"
    )
    parser.add_argument(
        "--mesh-error", type=float, default=0.25, metavar="PX", help="how far the bounded mesh may stray (%(default)s)"
    )
    parser.add_argument(
        "--close-holes",
        type=_hole,
        default=400,
        metavar="PIXELS",
        help="holes of up to so many pixels, and narrow ones, are closed along the surface; none, or all (%(default)s)",
    )
    parser.add_argument(
        "--smallest-part", type=int, default=150, metavar="PIXELS", help="loose parts under this go (%(default)s)"
    )
    parser.add_argument("--faces", type=int, default=50_000, help="triangles of the mesh; 0: all (%(default)s)")
    parser.add_argument(
        "--decimate-error",
        type=float,
        metavar="MM",
        help="as few as move the surface by this at most, in place of --faces",
    )
    parser.add_argument("--smoothing", type=int, default=10, help="passes of smoothing; 0: none (%(default)s)")
    parser.add_argument(
        "--unwrap", choices=("charts", "view"), default="charts", help="texture coordinates (%(default)s)"
    )


def read_mesh_options(options: argparse.Namespace) -> MeshOptions:
    """The options of `add_model`."""
    from stereo_gpu.config import MeshOptions

    return MeshOptions(
        method=options.mesh,
        error_px=options.mesh_error,
        largest_hole=options.close_holes,
        smallest_part=options.smallest_part,
        faces=options.faces,
        decimate_error=options.decimate_error,
        smoothing=options.smoothing,
        unwrap=options.unwrap,
    )


def add_texture_format(parser: argparse.ArgumentParser) -> None:
    """How the GLB holds its texture."""
    parser.add_argument(
        "--texture-format",
        choices=("png", "jpeg", "webp"),
        default="png",
        help="of the GLB: png is exact, jpeg small and fast, webp smallest but not read everywhere (%(default)s)",
    )


def numbers(kind: type, count: int) -> Callable[[str], tuple[float, ...]]:
    """A reader of `count` numbers with commas between them."""

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
    return "auto" if text == "auto" else numbers(int, 2)(text)


def _window(text: str) -> object:
    if text == "auto":
        return text
    try:
        return int(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r}: give the side of a square in px, or auto") from error


def _hole(text: str) -> int | None:
    if text in ("none", "all"):
        return 0 if text == "none" else None
    try:
        return int(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r}: give a number of pixels, none or all") from error
