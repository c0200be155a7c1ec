"""Pairs of board pictures: read, searched for the board, and told apart from pictures of another board."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from stereo_gpu.boards.board import Board, BoardView, in_both
from stereo_gpu.boards.hints import Hint, common_hint
from stereo_gpu.boards.picture_sizes import tell_sizes
from stereo_gpu.errors import CalibrationError, InputError, PictureError
from stereo_gpu.images import check_picture, read_image
from stereo_gpu.types import Picture

FEWEST_PAIRS = 3
FEWEST_IN_BOTH = 6  # corners that both cameras see
SURVEYED_PAIRS = 5  # looked at first, for boards of any size, so that a wrong count shows early
AGREEING_PAIRS = 2  # of them, if all pictures show the same other board

Source = str | os.PathLike[str] | Picture
Progress = Callable[[int, int], None]

logger = logging.getLogger(__name__)


@dataclass
class BoardPair:
    """One board pair on its way through the calibration.

    Args:
        names: of the left and the right picture.
        number: of the pair among all that the user has, from 1.
        views: what the left and the right picture show of the board; None where it was not found.
        reason: why the pair is left out; empty while it is in.
    """

    names: tuple[str, str]
    number: int
    views: list[BoardView | None] = field(default_factory=list)
    reason: str = ""

    def drop(self, reason: str) -> None:
        """Leave the pair out."""
        self.reason = reason
        logger.info("%s and %s left out: %s", *self.names, reason)


def find_pairs(
    left: Sequence[Source], right: Sequence[Source], board: Board, progress: Progress | None, first_number: int = 1
) -> tuple[list[BoardPair], list[tuple[int, int]]]:
    """Find the board in every picture, with one picture in memory at a time.

    Args:
        left, right: files or pictures, the pairs in one order.
        board: what they show.
        progress: told how many of the pictures have been searched, and how many there are.
        first_number: of the first pair, as messages count them.

    Returns:
        Every pair, in the order given, and the size (width, height) of the left and the right pictures.

    Raises:
        InputError: the lists do not fit each other, or `board` is none.
        PictureError: a picture cannot be read, or differs in size from the others of its camera.
        CalibrationError: too few pairs show the board; the message says which board they show instead.
    """
    sources = _named("left", left, first_number), _named("right", right, first_number)
    count = len(sources[0])
    if count != len(sources[1]):
        raise InputError(
            f"{count} left pictures but {len(sources[1])} right ones: give one right picture for each left one,"
            " in the same order"
        )
    if not isinstance(board, Board):
        raise InputError(f"board is {board!r:.60}: give one such as Board(10, 7, 30.0)")
    if count < FEWEST_PAIRS:
        given = "1 pair" if count == 1 else f"{count} pairs"
        raise CalibrationError(f"{given}: a calibration needs {FEWEST_PAIRS} or more, better 15")
    first = np.unique(np.linspace(0, count - 1, SURVEYED_PAIRS).astype(int)).tolist()
    sizes: list[tuple[int, int]] = []
    hints: list[Hint | None] = []
    pairs: dict[int, BoardPair] = {}
    for number in [*first, *(other for other in range(count) if other not in first)]:
        pair = pairs[number] = BoardPair((sources[0][number][0], sources[1][number][0]), first_number + number)
        for side in (0, 1):
            name, source = sources[side][number]
            picture = _read(name, source)
            size = _size(picture)
            if len(sizes) <= side:
                sizes.append(size)
            if size != sizes[side]:
                every = ((other, _size(_read(other, picture))) for other, picture in sources[side])
                raise PictureError(tell_sizes(("left", "right")[side], every))
            view = board.find(picture)
            pair.views.append(view)
            if number in first:
                hints.append(board.hint(picture, view))
            if progress is not None:
                progress(2 * len(pairs) - 1 + side, 2 * count)
        _leave_out_blank(pair, board)
        if number in first and len(pairs) >= AGREEING_PAIRS:
            # All of a few pictures are enough; else half of those that are looked at first.
            _refuse_other_board(hints, board, 0.5 if len(pairs) == len(first) else 1.0)
    found = [pairs[number] for number in range(count)]
    _refuse_too_few(found, board)
    _leave_out_repeated(found)
    _tell_layout(found)
    return found, sizes


def _named(side: str, sources: Sequence[Source], first_number: int) -> list[tuple[str, Source]]:
    if isinstance(sources, str | os.PathLike | np.ndarray):
        raise InputError(f"{side} is a single picture: give a list of at least {FEWEST_PAIRS}")
    return [
        (Path(source).name if isinstance(source, str | os.PathLike) else f"{side} {number}", source)
        for number, source in enumerate(sources, first_number)
    ]


def _read(name: str, source: Source) -> Picture:
    if isinstance(source, str | os.PathLike):
        return read_image(source)
    check_picture(name, source)
    return source


def _size(picture: Picture) -> tuple[int, int]:
    return picture.shape[1], picture.shape[0]


def _leave_out_blank(pair: BoardPair, board: Board) -> None:
    left, right = pair.views
    if left is None or right is None:
        blank = [side for side, view in (("left", left), ("right", right)) if view is None]
        lack = "no whole board" if board.whole else "too little of the board"
        pair.drop(f"{lack} in the {' and the '.join(blank)} picture")
        return
    common = len(in_both(left, right)[0].ids)
    if common < FEWEST_IN_BOTH:
        pair.drop(f"left and right see {common} corners of the board in common, {FEWEST_IN_BOTH} are needed")


def _leave_out_repeated(pairs: list[BoardPair]) -> None:
    """Leave out what was copied, or comes from a film that stood still: it would count as new evidence."""
    earlier: dict[bytes, BoardPair] = {}
    for pair in pairs:
        if pair.reason:
            continue
        corners = b"".join(view.corners.tobytes() for view in pair.views if view is not None)
        first = earlier.setdefault(corners, pair)
        if first is not pair:
            pair.drop(f"the same pictures as an earlier pair: {first.names[0]}, {first.names[1]}")


def _refuse_other_board(hints: list[Hint | None], board: Board, share: float) -> None:
    """Stop early if so many pictures show another board, of which this one may be a part."""
    hint = common_hint(hints, share)
    if hint:
        raise CalibrationError(f"looked for a board of {board.described}, {hint}")


def _refuse_too_few(pairs: list[BoardPair], board: Board) -> None:
    usable = sum(not pair.reason for pair in pairs)
    if usable >= FEWEST_PAIRS:
        return
    boards = sum(view is not None for pair in pairs for view in pair.views)
    if board.whole:
        wanted, way_out = "a whole board", "give the squares as printed, and take pictures that show all of them"
    else:
        wanted = "enough of a board"
        way_out = "give squares and markers as printed, and let both cameras see the same part of the board, sharp"
    raise CalibrationError(
        f"{usable} of {len(pairs)} pairs show {wanted} of {board.described} in both pictures ({boards} of"
        f" {2 * len(pairs)} pictures do), {FEWEST_PAIRS} are needed: {way_out}"
    )


def _tell_layout(pairs: list[BoardPair]) -> None:
    """Say which of OpenCV's two layouts of markers was found, where it is not today's."""
    views = [view for pair in pairs for view in pair.views if view is not None]
    legacy = sum(view.legacy for view in views)
    if 0 < legacy < len(views):
        logger.warning(
            "%d of %d pictures show markers as OpenCV before 4.6 drew them, the others as it does now: are these two"
            " boards?",
            legacy,
            len(views),
        )
    elif legacy:
        logger.info("the markers stand as OpenCV before 4.6 drew them: top left square white")
