"""What several commands take."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path


def add_pair(parser: argparse.ArgumentParser) -> None:
    """Two pictures."""
    parser.add_argument("left", type=Path, help="the left camera's picture")
    parser.add_argument("right", type=Path, help="the right camera's picture")


def add_rig(parser: argparse.ArgumentParser) -> None:
    """A rig's file."""
    parser.add_argument(
        "--rig",
        type=Path,
        required=True,
        metavar="rig.json",
        help="what `calibrate` wrote, or a calibration file of OpenCV, ROS (the folder), Matlab, Middlebury or KITTI",
    )


def add_backend(parser: argparse.ArgumentParser) -> None:
    """The device."""
    parser.add_argument("--backend", help="where to compute, as `devices` names it; by default the best device")


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
