"""Render a scene with known truth, reconstruct it and measure the error."""

from __future__ import annotations

import argparse
from pathlib import Path

from stereo_gpu.commands.arguments import add_backend


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what the command takes."""
    parser.add_argument("--out", type=Path, default=Path("demo-out"), help="folder for the results (%(default)s)")
    add_backend(parser)


def run(options: argparse.Namespace) -> None:
    """Render the built-in scene, reconstruct it and print the errors."""
    from stereo_gpu.demo import run_demo

    for line in run_demo(options.out, backend=options.backend):
        print(line, flush=True)
