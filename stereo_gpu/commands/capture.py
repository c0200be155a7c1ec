"""Take pairs of pictures with two cameras."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what the command takes."""
    parser.add_argument("left", help="number, device path, or video file of the left camera")
    parser.add_argument("right", help="the same of the right camera")
    parser.add_argument("--out", type=Path, required=True, help="folder for left0001.png, right0001.png, ...")
    parser.add_argument("--count", type=int, default=15, help="how many pairs to take (%(default)s)")
    parser.add_argument("--interval", type=float, default=2.0, help="seconds between pairs (%(default)s)")


def run(options: argparse.Namespace) -> None:
    """Take pairs of pictures."""
    from stereo_gpu.capture import capture

    for taken in capture(options.left, options.right, options.out, count=options.count, interval=options.interval):
        print(f"pair {taken.number}: {taken.left.name}, {taken.right.name}, skew {taken.skew_ms:.1f} ms", flush=True)
