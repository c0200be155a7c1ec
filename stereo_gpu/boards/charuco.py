"""The ChArUco board: a checkerboard with a marker in each white square, of which a part is enough."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import cv2
import numpy as np

from stereo_gpu.boards.board import Board, BoardView
from stereo_gpu.boards.checkerboard import FEWEST_SQUARES, WORKING_SIDE, place_corners, shrunk, too_thin
from stereo_gpu.boards.hints import Hint
from stereo_gpu.boards.marker_hints import hint_charuco
from stereo_gpu.boards.markers import (
    Markers,
    agreeing,
    dictionary_name,
    dictionary_size,
    find_markers,
    interpolate,
    marker_squares,
    steps_between,
)
from stereo_gpu.boards.neighbours import fits_neighbours
from stereo_gpu.errors import InputError
from stereo_gpu.images import grey
from stereo_gpu.types import Bytes, Floats, Ints, Picture

FEWEST_CORNERS = 6  # that a view must show, in two rows at least
FEWEST_MARKERS = 4
SMALLEST_REACH = 1.3  # px from a corner to the next marker: a window of 2 px, rounded, does little harm
LARGEST_COPY = 4  # times the picture, to place corners that have markers close by
ENOUGH = 0.5  # of the board's corners: no need to look at another size of the picture


@dataclass(frozen=True, init=False)
class CharucoBoard(Board):
    """A checkerboard with markers of a dictionary of OpenCV in its white squares, ids from 0 at the top left.

    The markers name the corners, so that a part of the board counts and both cameras agree on the ends. Boards that
    OpenCV before 4.6 drew with an even number of rows, whose top left square is white, are recognised as well.

    Args:
        columns, rows: number of squares, 4 to 200 each.
        square: side of one square, in `unit`.
        marker: side of one marker with its black border, in `unit`.
        dictionary: of the markers, such as 5x5_250 or apriltag_36h11.
        unit: unit of length, and so of the rig that the board calibrates.

    Raises:
        InputError: no board has these numbers, or the dictionary is unknown or too small.
    """

    marker: float = 0.0
    dictionary: str = "5x5_250"

    whole: ClassVar[bool] = False

    # Written out, since a dataclass would put `marker` behind `unit`.
    def __init__(
        self, columns: int, rows: int, square: float, marker: float, dictionary: str = "5x5_250", unit: str = "mm"
    ) -> None:
        given = {"columns": columns, "rows": rows, "square": square, "marker": marker, "unit": unit}
        for name, value in given.items():
            object.__setattr__(self, name, value)
        object.__setattr__(self, "dictionary", dictionary_name(dictionary))
        self.__post_init__()

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            marker = float(self.marker)
        except (TypeError, ValueError):
            marker = math.nan
        if not 0 < marker < self.square:
            raise InputError(
                f"board marker is {self.marker!r:.60}: give the side of a marker with its black border, less than"
                f" the square's {self.square:g} {self.unit}"
            )
        object.__setattr__(self, "marker", marker)
        needed, there = len(marker_squares(self.columns, self.rows)), dictionary_size(self.dictionary)
        if needed > there:
            raise InputError(
                f"a {self} board has {needed} markers, dictionary {self.dictionary} has {there}: take fewer squares or"
                " a larger dictionary; the largest, such as 5x5_1000, have 1000"
            )

    @property
    def turns(self) -> tuple[int, ...]:
        """The markers tell every turn from the others."""
        return (0,)

    @property
    def described(self) -> str:
        """What it is, for messages."""
        return f"{self} squares with markers of {self.dictionary}"

    def find(self, picture: Picture) -> BoardView | None:
        """Find what a picture shows of the board; None if that is too little to count.

        Markers that do not stand to a neighbour as on the board are left out; `view.legacy` says which of OpenCV's
        two layouts they follow.
        """
        flat = grey(picture)
        if too_thin(flat, FEWEST_SQUARES):
            return None
        best: BoardView | None = None
        for copy in _copies(flat):
            view = self._look(flat, copy)
            if view is not None and (best is None or len(view.ids) > len(best.ids)):
                best = view
            if best is not None and len(best.ids) >= ENOUGH * len(self.points):
                break
        return best

    def hint(self, picture: Picture, view: BoardView | None) -> Hint | None:
        """Say in words which other board the picture shows, and what to do; None where it seems to be this one."""
        return hint_charuco(
            grey(picture), self.columns, self.rows, self.marker / self.square, self.dictionary, view is not None
        )

    def _look(self, flat: Bytes, copy: Bytes) -> BoardView | None:
        found = find_markers(copy, self.dictionary)
        if len(found) < FEWEST_MARKERS:
            return None
        ratio = self.marker / self.square
        steps = steps_between(found, ratio)
        layouts = {
            legacy: agreeing(found, steps, marker_squares(self.columns, self.rows, legacy))
            for legacy in ((False, True) if self.rows % 2 == 0 else (False,))
        }
        legacy = max(layouts, key=lambda layout: int(layouts[layout].sum()))
        markers: Markers = found.only(layouts[legacy])
        if len(markers) < FEWEST_MARKERS:
            return None
        corners, ids = interpolate(copy, markers, self.columns, self.rows, ratio, self.dictionary, legacy)
        rising = np.argsort(ids)
        corners, ids = corners[rising], ids[rising]
        if not _spread(ids, self.columns - 1):
            return None
        # The window must not reach the markers, which stand (1 - ratio) / 2 squares from the corner.
        scale = flat.shape[1] / copy.shape[1], flat.shape[0] / copy.shape[0]
        side = float(np.linalg.norm(np.diff(markers.outlines, axis=1), axis=-1).min()) / ratio * min(scale)
        placed = _place(flat, (corners + 0.5) * scale - 0.5, side * (1 - ratio) / 2)
        fits = fits_neighbours(placed, np.column_stack([ids % (self.columns - 1), ids // (self.columns - 1)]))
        return BoardView(placed[fits], ids[fits], legacy) if _spread(ids[fits], self.columns - 1) else None


def _place(flat: Bytes, corners: Floats, reach: float) -> Floats:
    """Where the edges meet; on an enlarged copy where the markers are so close that no window of whole px fits."""
    times = min(LARGEST_COPY, math.ceil(2 / max(reach, 0.1)))
    if reach >= SMALLEST_REACH or max(flat.shape) * times > 2 * WORKING_SIDE:
        return place_corners(flat, corners, reach)
    large = cv2.resize(flat, None, fx=times, fy=times, interpolation=cv2.INTER_CUBIC)
    placed = place_corners(large, (corners + 0.5) * times - 0.5, reach * times)
    return np.asarray((placed + 0.5) / times - 0.5, np.float32)


def _copies(flat: Bytes) -> Iterator[Bytes]:
    """Where to look, the likeliest first."""
    small = shrunk(flat)
    yield small
    if small is not flat:
        yield shrunk(flat, 2 * WORKING_SIDE)
    elif 2 * max(flat.shape) <= WORKING_SIDE:
        yield cv2.resize(flat, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)


def _spread(ids: Ints, columns: int) -> bool:
    """Whether corners fix a plane: enough of them, two or more in each of two rows."""
    if len(ids) < FEWEST_CORNERS:
        return False
    in_rows = np.bincount(ids // columns)
    return bool((in_rows >= 2).sum() >= 2)
