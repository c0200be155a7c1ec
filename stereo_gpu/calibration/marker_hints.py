"""Which ChArUco board a picture shows, when it is not the one that was named."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereo_gpu.calibration.checkerboard import survey_checkerboard
from stereo_gpu.calibration.hints import Hint
from stereo_gpu.calibration.markers import (
    FAMILIES,
    agreeing,
    dictionary_size,
    find_markers,
    marker_squares,
    steps_between,
)
from stereo_gpu.types import Bytes

FEWEST_AGREEING = 4  # markers that stand to each other as on a board
LEAST_SHARE = 0.5  # of the markers found
WIDEST = 40  # squares; boards that are wider are not guessed
USUAL_RATIO = 0.75  # marker over square, where nothing is known


@dataclass(frozen=True, kw_only=True)
class SeenMarkers:
    """A board as its markers show it.

    Args:
        family: of the dictionary.
        columns: squares across.
        legacy: whether the top left square is white.
        last: the largest id.
        agreeing: how many markers stand as on such a board.
    """

    family: str
    columns: int
    legacy: bool
    last: int
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


def see_markers(flat: Bytes, ratio: float, families: tuple[str, ...] = tuple(FAMILIES)) -> SeenMarkers | None:
    """Which dictionary's markers a picture shows, and how wide the board is on which they stand as they do.

    Args:
        flat: (H, W).
        ratio: side of a marker over side of a square.
        families: of the dictionaries to try.
    """
    best: SeenMarkers | None = None
    for family in families:
        found = find_markers(flat, FAMILIES[family][-1])
        if len(found) < FEWEST_AGREEING:
            continue
        steps = steps_between(found, ratio)
        last = int(found.ids.max())
        for columns in range(4, WIDEST + 1):
            for legacy in (False, True):
                rows = 2 * (last // columns + 2)
                fits = int(agreeing(found, steps, marker_squares(columns, rows, legacy)).sum())
                if fits >= max(FEWEST_AGREEING, LEAST_SHARE * len(found)) and (best is None or fits > best.agreeing):
                    best = SeenMarkers(family=family, columns=columns, legacy=legacy, last=last, agreeing=fits)
    return best


def hint_charuco(flat: Bytes, columns: int, rows: int, ratio: float, dictionary: str, found: bool) -> Hint | None:
    """What a picture shows instead of a ChArUco board, or more of than it has.

    Args:
        flat: (H, W).
        columns, rows, ratio, dictionary: of the board that was named.
        found: whether part of it was found.
    """
    own = next(family for family, members in FAMILIES.items() if dictionary in members)
    seen = see_markers(flat, ratio, (own,))
    if seen is None and not found:
        seen = see_markers(flat, ratio)
    if seen is None:
        return None if found else _mirrored(flat, ratio, own) or _plain(flat)
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
    return None


def hint_unexpected_markers(flat: Bytes) -> Hint | None:
    """What a picture shows in which a plain checkerboard was looked for."""
    seen = see_markers(flat, USUAL_RATIO)
    if seen is None:
        return None
    return Hint(
        f"ChArUco {seen.family}",
        f"found a ChArUco board with markers of dictionary {seen.dictionary}: say --board"
        f" {seen.columns}x{seen.rows} --dictionary {seen.dictionary} and --marker with the side of a marker",
        seen.last,
    )


def _mirrored(flat: Bytes, ratio: float, family: str) -> Hint | None:
    if see_markers(np.ascontiguousarray(flat[:, ::-1]), ratio, (family,)) is None:
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
