"""Draw a board in true size, to be printed."""

from __future__ import annotations

import argparse
from pathlib import Path

from stereo_gpu.commands.arguments import add_board, read_board

MOST_MARKER = 0.8  # of a square; at 0.9 corners in small pictures were four times as far off


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what the command takes."""
    add_board(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="board.pdf", help="file to write, .pdf or .png")
    parser.add_argument(
        "--paper",
        default="fit",
        help="a0 to a5, letter, legal or tabloid; by default a page as large as the board needs (%(default)s)",
    )


def run(options: argparse.Namespace) -> None:
    """Draw the board and say how large it is."""
    from stereo_gpu.boards.board_print import print_board
    from stereo_gpu.files import check_writable_file

    board = read_board(options)
    check_writable_file(options.out)
    if options.marker is not None and options.marker > MOST_MARKER * board.square:
        print(f"markers this close to the corners disturb them: take {MOST_MARKER * board.square:g} mm or less")
    printed = print_board(board, options.out, paper=options.paper)
    dots = f", {printed.dots_per_mm * 25.4:.2f} dots an inch" if printed.dots_per_mm is not None else ""
    print(
        f"{printed.path}: {board.described}, {board.square:g} {board.unit} each, on a page of"
        f" {printed.width_mm:.1f} x {printed.height_mm:.1f} mm{dots}"
    )
    print(
        f"print it at 100 %, not fitted to the page; then {board.columns} squares must measure"
        f" {board.columns * board.square:g} {board.unit}, else tell calibrate what they do measure"
    )
