"""A board by what it is called: its squares, and its markers if it has some."""

from __future__ import annotations

from stereo_gpu.boards.board import Board, parse_squares
from stereo_gpu.boards.charuco import CharucoBoard
from stereo_gpu.errors import InputError


def choose_board(
    squares: str, square: float | None, marker: float | None = None, dictionary: str | None = None, *, dashes: str = ""
) -> Board:
    """A checkerboard, or a ChArUco board where the side of a marker is given.

    Args:
        squares: columns x rows, such as "10x7".
        square: side of a square, mm; None where only the pattern matters, which then has squares of 1.
        marker: side of a marker, mm.
        dictionary: of the markers; "5x5_250" unless it is said.
        dashes: what stands before the names of these in messages.

    Raises:
        InputError: there is no such board, or what is said of markers lacks their side or that of the squares.
    """
    if marker is None:
        if dictionary is not None:
            raise InputError(
                f"{dashes}dictionary {dictionary!s:.60} stands without {dashes}marker: say the side of a marker too"
            )
        return Board.parse(squares, 1.0 if square is None else square)
    if square is None:
        raise InputError(f"{dashes}marker {marker:g} stands without {dashes}square: say the side of a square too")
    columns, rows = parse_squares(squares)
    return CharucoBoard(columns, rows, square, marker, dictionary or "5x5_250")
