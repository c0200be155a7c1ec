"""Where a board, a ruler and the words that belong to it stand on a sheet of paper."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereo_gpu.boards.board import Board
from stereo_gpu.boards.board_drawing import black_rectangles
from stereo_gpu.boards.charuco import CharucoBoard
from stereo_gpu.errors import InputError
from stereo_gpu.types import Doubles

PAPERS = {  # width and height upright, mm
    "a0": (841.0, 1189.0),
    "a1": (594.0, 841.0),
    "a2": (420.0, 594.0),
    "a3": (297.0, 420.0),
    "a4": (210.0, 297.0),
    "a5": (148.0, 210.0),
    "letter": (215.9, 279.4),
    "legal": (215.9, 355.6),
    "tabloid": (279.4, 431.8),
}
FIT = "fit"  # a page as large as the board needs
MILLIMETRES = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4, "inch": 25.4}
MARGIN = 7.0  # mm around everything: printers leave some 5 mm white, and the finders want it white
STRIP = 9.0  # mm below the board for the ruler, and the words where they stand beside it
GAP = 3.5  # mm between board and ruler
APART = 10.0  # mm between ruler and words
RULER = 100.0  # mm
TICK = 10.0  # mm between ticks
TEXT = 2.6  # mm, height of the letters' line
SMALLEST_TEXT = 1.8  # mm
LINE = 1.3  # of the text's height, from line to line
LETTER = 0.6  # of a line's height: width of a letter in the fonts used, at most
SMALLEST_SQUARE = 0.5  # mm
LARGEST_PAGE = 5080.0  # mm: PDF allows no larger one


@dataclass(frozen=True)
class Words:
    """One line of text.

    Args:
        x, y: mm from the sheet's top left corner to the left end of its base line.
        size: mm, height of the line.
        text: in ASCII.
    """

    x: float
    y: float
    size: float
    text: str


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """A page, in mm from its top left corner, y down.

    Args:
        width, height: of the page.
        origin: the board's top left corner.
        board: (n, 4) x, y, width and height of the board's black parts.
        ruler: (n, 4) the same of the ruler.
        words: what is written.
        ruler_length: mm from the ruler's first tick to its last.
    """

    width: float
    height: float
    origin: tuple[float, float]
    board: Doubles
    ruler: Doubles
    words: tuple[Words, ...]
    ruler_length: float


def lay_out(board: Board, paper: str) -> Sheet:
    """Centre a board on a sheet of paper, upright or lying as it fits, with a ruler and its name below it.

    Args:
        board: of a unit that is known in millimetres.
        paper: a name of `PAPERS`, or "fit" for a page as large as needed.

    Raises:
        InputError: the paper or the unit is unknown, or the board does not fit; the message says what would.
    """
    scale = _millimetres(board)
    if board.square * scale < SMALLEST_SQUARE:
        raise InputError(
            f"squares of {board.square:g} {board.unit} are too small to print: take {SMALLEST_SQUARE} mm or more"
        )
    size = np.array([board.columns, board.rows]) * board.square * scale
    length = float(min(RULER, np.floor(size[0] / TICK) * TICK))
    written = _written(board, scale)
    longest = max(len(line) for line in written) * LETTER
    # The words stand beside the ruler where there is room for a size that can be read, else below it.
    room = size[0] - length - APART
    beside = room >= SMALLEST_TEXT * longest
    strip = STRIP if beside else STRIP + 2 * LINE * TEXT
    width, height = _page(board, size, paper, strip, longest * SMALLEST_TEXT)
    x = (width - size[0]) / 2
    y = min((height - size[1]) / 2, height - MARGIN - strip - size[1])
    ruler, labels = _ruler(x, y + size[1] + GAP, length)
    text = min(TEXT, (room if beside else width - 2 * MARGIN) / longest)
    at = x + length + APART if beside else min(x, width - MARGIN - longest * text)
    first = y + size[1] + GAP + (text if beside else STRIP - GAP + text)
    words = [Words(at, first + number * LINE * text, text, line) for number, line in enumerate(written)]
    rectangles = black_rectangles(board) * scale
    rectangles[:, :2] += (x, y)
    return Sheet(
        width=width,
        height=height,
        origin=(float(x), float(y)),
        board=rectangles,
        ruler=ruler,
        words=(*labels, *words),
        ruler_length=length,
    )


def _millimetres(board: Board) -> float:
    if board.unit not in MILLIMETRES:
        raise InputError(f"board unit {board.unit!r:.60} has no length on paper: give one of {', '.join(MILLIMETRES)}")
    return MILLIMETRES[board.unit]


def _page(board: Board, size: Doubles, paper: str, strip: float, words: float) -> tuple[float, float]:
    """Width and height of the page."""
    around = np.array([2 * MARGIN, 2 * MARGIN + strip])
    name = str(paper).strip().lower()
    if name == FIT:
        page = np.maximum(size, [words, 0]) + around
        if page.max() > LARGEST_PAGE:
            raise InputError(
                f"a {board} board of {board.square:g} {board.unit} squares needs a page of {page[0]:.6g} x"
                f" {page[1]:.6g} mm, {LARGEST_PAGE:.0f} mm is the limit: take smaller squares"
            )
        return float(page[0]), float(page[1])
    if name not in PAPERS:
        raise InputError(
            f"paper {paper!r:.60}: give one of {', '.join(PAPERS)}, or {FIT} for a page of the board's size"
        )
    upright = np.array(PAPERS[name])
    pages = [upright[::-1], upright] if size[0] > size[1] else [upright, upright[::-1]]
    for page in pages:
        if (size + around <= page + 1e-9).all():
            return float(page[0]), float(page[1])
    squares = np.array([board.columns, board.rows])
    largest = max(float(((page - around) / squares).min()) for page in pages) / MILLIMETRES[board.unit]
    # Rounded down to what a ruler can check.
    told = np.floor(largest * 2) / 2 if largest >= 1 else np.floor(largest * 100) / 100
    mend = f"the largest that fits are {told:g} {board.unit}; take those" if told > 0 else "take fewer squares"
    raise InputError(
        f"a {board} board of {board.square:g} {board.unit} squares does not fit {name}: {mend}, a larger paper,"
        f" or {FIT}, a page of the board's size"
    )


def _written(board: Board, scale: float) -> tuple[str, ...]:
    square = f"{board.square * scale:g} mm"
    if isinstance(board, CharucoBoard):
        name = f"ChArUco, dictionary {board.dictionary}, markers of {board.marker * scale:g} mm"
    else:
        name = "checkerboard"
    return f"{name}: print at 100 %, then measure:", f"{board.columns} x {board.rows} squares of {square}"


def _ruler(x: float, y: float, length: float) -> tuple[Doubles, list[Words]]:
    """A bar with ticks and its length."""
    thin = 0.2
    ticks = np.arange(round(length / TICK) + 1) * TICK
    bars = [(x + tick - thin / 2, y, thin, 2.2 if tick in (0, length) else 1.4) for tick in ticks]
    bars.append((x - thin / 2, y, length + thin, thin))
    return np.array(bars), [Words(x + 1, y + 3.4, 2.0, f"{length:g} mm")] if length else []
