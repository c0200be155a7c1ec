"""The checkerboard, and what a picture shows of a board."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from stereo_gpu.boards.checkerboard import FEWEST_SQUARES, find_checkerboard, survey_checkerboard
from stereo_gpu.boards.hints import Hint
from stereo_gpu.boards.marker_hints import hint_unexpected_markers
from stereo_gpu.errors import InputError
from stereo_gpu.images import grey
from stereo_gpu.rig import check_unit
from stereo_gpu.types import Floats, Ints, Picture

MOST_SQUARES = 200
SIDES_OF_SQUARES = 1e-6, 1e6  # in any unit: float32 holds their places, and OpenCV can solve for their poses


@dataclass(frozen=True, eq=False)
class BoardView:
    """What one picture shows of a board.

    Args:
        corners: (n, 2) float32 px, where the inner corners are.
        ids: (n,) int32, which of `board.points` each is, in rising order; a checkerboard always gives all.
        legacy: whether markers stand as OpenCV before 4.6 drew them where the number of rows is even.
    """

    corners: Floats
    ids: Ints
    legacy: bool = False

    @classmethod
    def whole(cls, corners: Floats) -> BoardView:
        """Of corners that are all that the board has, in the order of its points."""
        return cls(corners, np.arange(len(corners), dtype=np.int32))

    def only(self, ids: Ints) -> BoardView:
        """The part with these ids, all of which must be in view."""
        at = np.searchsorted(self.ids, ids)
        return replace(self, corners=self.corners[at], ids=self.ids[at])


def in_both(left: BoardView, right: BoardView) -> tuple[BoardView, BoardView]:
    """The corners that both views show, in one order."""
    ids = np.intersect1d(left.ids, right.ids)
    return left.only(ids), right.only(ids)


@dataclass(frozen=True)
class Board:
    """A checkerboard, named by its squares as printed: 10 x 7 squares have 9 x 6 inner corners.

    Args:
        columns, rows: number of squares, 4 to 200 each.
        square: side of one square, in `unit`.
        unit: unit of length, and so of the rig that the board calibrates.

    Raises:
        InputError: no board has these numbers.
    """

    columns: int
    rows: int
    square: float
    unit: str = "mm"

    # Whether a picture counts only if it shows all of the board.
    whole: ClassVar[bool] = True

    def __post_init__(self) -> None:
        for name in ("columns", "rows"):
            count = getattr(self, name)
            if isinstance(count, bool) or not isinstance(count, int | np.integer):
                raise InputError(f"board {name} is {count!r:.60}: give a whole number of squares")
            if not FEWEST_SQUARES <= count <= MOST_SQUARES:
                raise InputError(
                    f"board {name} is {count}: give {FEWEST_SQUARES} to {MOST_SQUARES} squares, as printed"
                )
            object.__setattr__(self, name, int(count))
        try:
            square = float(self.square)
        except (TypeError, ValueError):
            square = math.nan
        if not SIDES_OF_SQUARES[0] <= square <= SIDES_OF_SQUARES[1]:
            raise InputError(f"board square is {self.square!r:.60}: give the side of one square, such as 30.0 mm")
        object.__setattr__(self, "square", square)
        check_unit(self.unit)

    @classmethod
    def parse(cls, text: str, square: float, unit: str = "mm") -> Board:
        """Read a checkerboard from text such as "10x7": columns and rows of squares.

        Raises:
            InputError: the text is no such thing.
        """
        return Board(*parse_squares(text), square, unit)

    def __str__(self) -> str:
        return f"{self.columns}x{self.rows}"

    @property
    def corners(self) -> tuple[int, int]:
        """Columns and rows of inner corners."""
        return self.columns - 1, self.rows - 1

    @property
    def described(self) -> str:
        """What it is, for messages."""
        return f"{self} squares ({self.corners[0]}x{self.corners[1]} inner corners)"

    @property
    def points(self) -> Floats:
        """The inner corners on the board, (N, 3) float32 in `unit`, row by row, z = 0."""
        columns, rows = self.corners
        points = np.zeros((rows, columns, 3), np.float32)
        points[..., 0], points[..., 1] = np.meshgrid(np.arange(columns), np.arange(rows))
        result: Floats = points.reshape(-1, 3) * np.float32(self.square)
        return result

    @property
    def turns(self) -> tuple[int, ...]:
        """By how many times 90 degrees the board may be turned without looking otherwise to its finder."""
        return (0, 1, 2, 3) if self.columns == self.rows else (0, 2)

    def find(self, picture: Picture) -> BoardView | None:
        """Find the whole board in a picture; None if it is not there.

        Which of its ends is the first corner is left open; going along a row and then down the rows always turns
        clockwise.
        """
        corners = find_checkerboard(picture, self.corners)
        return None if corners is None else BoardView.whole(corners)

    def hint(self, picture: Picture, view: BoardView | None) -> Hint | None:
        """Say which other board the picture shows, and what to do; None where it seems to be this one.

        Args:
            picture: any picture.
            view: what `find` found in it.
        """
        size = survey_checkerboard(picture)
        given = max(self.columns, self.rows), min(self.columns, self.rows)
        # The finder finds a part of a board, too, but not the same part in both cameras.
        if view is not None and (size is None or size[0] < given[0] or size[1] < given[1]):
            return None
        if view is None and (marked := hint_unexpected_markers(grey(picture))) is not None:
            return marked
        if size is None or size == given:
            return None
        told = f"{size[0]}x{size[1]}"
        return Hint(told, f"found {size[0] - 1}x{size[1] - 1} inner corners = {told} squares: say {told}")


def parse_squares(text: str) -> tuple[int, int]:
    """Read columns and rows of squares from text such as "10x7".

    Raises:
        InputError: the text is no such thing.
    """
    parts = re.fullmatch(r"\s*(\d{1,6})\s*[xX×]\s*(\d{1,6})\s*", text, re.ASCII)
    if parts is None:
        raise InputError(f"board {text!r:.60}: give columns x rows of squares as printed, such as 10x7")
    return int(parts[1]), int(parts[2])
