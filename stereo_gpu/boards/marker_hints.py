"""Which ChArUco board a picture shows, when it is not the one that was named."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereo_gpu.boards.checkerboard import FEWEST_SQUARES, shrunk, survey_checkerboard, too_thin
from stereo_gpu.boards.hints import Hint
from stereo_gpu.boards.markers import (
    FAMILIES,
    agreeing,
    diagonal_neighbours,
    dictionary_size,
    find_markers,
    marker_squares,
    steps_between,
)
from stereo_gpu.types import Bytes

FEWEST_AGREEING = 4  # markers that stand to each other as on a board
LEAST_SHARE = 0.5  # of the markers found
CLEAR_SHARE = 0.8  # of twice as many: no other dictionary can be meant
WORKING_SIDE = 1000  # px: whoever names a wrong board shows it large enough for that
WIDEST = 40  # squares; boards that are wider are not guessed
WRONG_RATIO = 0.12  # of marker over square, by which what is seen may differ: blur makes small markers smaller


@dataclass(frozen=True, kw_only=True)
class SeenMarkers:
    """A board as its markers show it.

    Args:
        family: of the dictionary.
        columns: squares across.
        legacy: whether the top left square is white.
        last: the largest id.
        ratio: side of a marker over side of a square.
        agreeing: how many markers stand as on such a board.
    """

    family: str
    columns: int
    legacy: bool
    last: int
    ratio: float
    agreeing: int

    @property
    def rows(self) -> int:
        """Squares down, as far as they were seen."""
        rows = 1
        while len(marker_squares(self.columns, rows, legacy=False)) <= self.last:
            rows += 1
        # OpenCV before 4.6 began with a white square only where the number of rows is even.
        return rows + rows % 2 if self.legacy else rows

    @property
    def dictionary(self) -> str:
        """The shortest dictionary that has them."""
        return next(name for name in FAMILIES[self.family] if dictionary_size(name) > self.last)


def see_markers(flat: Bytes, families: tuple[str, ...] = tuple(FAMILIES)) -> SeenMarkers | None:
    """Which dictionary's markers a picture shows, and how wide the board is on which they stand as they do.

    Args:
        flat: (H, W).
        families: of the dictionaries to try.
    """
    if too_thin(flat, FEWEST_SQUARES):
        return None
    flat = shrunk(flat, WORKING_SIDE)
    best: SeenMarkers | None = None
    for family in families:
        # The longest dictionaries take long to compare with; few boards have more than 250 markers.
        found = find_markers(flat, FAMILIES[family][-1 if len(families) == 1 else -2 :][0])
        if len(found) < FEWEST_AGREEING:
            continue
        steps = steps_between(found, 1.0)
        last = int(found.ids.max())
        for columns in range(4, WIDEST + 1):
            for legacy in (False, True):
                squares = marker_squares(columns, 2 * (last // columns + 2), legacy)
                # In sides of a marker, a diagonal neighbour is as far off as the square is larger.
                apart = np.abs(steps[diagonal_neighbours(found, squares)])
                if not apart.size:
                    continue
                ratio = 1 / float(np.median(apart))
                fits = int(agreeing(found, steps * ratio, squares).sum())
                if fits >= max(FEWEST_AGREEING, LEAST_SHARE * len(found)) and (best is None or fits > best.agreeing):
                    best = SeenMarkers(
                        family=family, columns=columns, legacy=legacy, last=last, ratio=ratio, agreeing=fits
                    )
        if best is not None and best.agreeing >= max(2 * FEWEST_AGREEING, CLEAR_SHARE * len(found)):
            break
    return best


def hint_charuco(flat: Bytes, columns: int, rows: int, ratio: float, dictionary: str, found: bool) -> Hint | None:
    """What a picture shows instead of a ChArUco board, or more of than it has.

    Args:
        flat: (H, W).
        columns, rows, ratio, dictionary: of the board that was named.
        found: whether part of it was found.
    """
    own = next(family for family, members in FAMILIES.items() if dictionary in members)
    seen = see_markers(flat, (own,))
    if seen is None and not found:
        seen = see_markers(flat)
    if seen is None:
        return None if found else _mirrored(flat, own) or _plain(flat)
    last = len(marker_squares(columns, rows)) - 1
    size = f"{seen.columns}x{seen.rows}"
    if seen.family != own or seen.last >= dictionary_size(dictionary):
        return Hint(
            f"dictionary {seen.family}",
            f"found markers of dictionary {seen.dictionary}, not {dictionary}: say --dictionary {seen.dictionary}",
            seen.last,
        )
    if seen.columns != columns:
        return Hint(
            f"{seen.columns} columns",
            f"found ids up to {seen.last} that stand as on a board {seen.columns} squares wide: say {size}",
            seen.last,
        )
    if seen.last > last:
        return Hint(
            "more rows",
            f"found ids up to {seen.last}, which a {columns}x{rows} board does not have (0 to {last}): say {size}",
            seen.last,
        )
    if abs(seen.ratio / ratio - 1) > WRONG_RATIO:
        return Hint(
            "ratio",
            f"found markers whose side is {seen.ratio:.2f} of a square's, not {ratio:.2f}: measure both, the marker"
            " with its black border",
            seen.agreeing,
        )
    return None


def hint_unexpected_markers(flat: Bytes) -> Hint | None:
    """What a picture shows in which a plain checkerboard was looked for."""
    seen = see_markers(flat)
    if seen is None:
        return None
    return Hint(
        f"ChArUco {seen.family}",
        f"found a ChArUco board with markers of dictionary {seen.dictionary}: say --board"
        f" {seen.columns}x{seen.rows} --dictionary {seen.dictionary} and --marker with the side of a marker",
        seen.last,
    )


def _mirrored(flat: Bytes, family: str) -> Hint | None:
    if see_markers(np.ascontiguousarray(flat[:, ::-1]), (family,)) is None:
        return None
    return Hint(
        "mirrored", "found it mirrored: turn mirroring off in the camera's settings and take the pictures again"
    )


def _plain(flat: Bytes) -> Hint | None:
    size = survey_checkerboard(flat)
    if size is None:
        return None
    return Hint(
        f"plain {size}",
        f"found a plain checkerboard of {size[0]}x{size[1]} squares and no markers: leave out --marker and say"
        f" {size[0]}x{size[1]}",
    )
