"""Which parts of the picture, distances and tilts the views of a board cover, and what is missing."""

from __future__ import annotations

from collections.abc import Collection
from enum import StrEnum

import numpy as np

from stereo_gpu.calibration.board import BoardView
from stereo_gpu.calibration.placement import KnownPoints, Placement, place
from stereo_gpu.types import Ints

COLUMNS, ROWS = 8, 6  # cells of the picture
REGIONS = (  # name, rows and columns of its cells: corners and edges two cells deep, and the middle
    ("top left", slice(0, 2), slice(0, 2)),
    ("top", slice(0, 2), slice(2, 6)),
    ("top right", slice(0, 2), slice(6, 8)),
    ("left", slice(2, 4), slice(0, 2)),
    ("middle", slice(2, 4), slice(2, 6)),
    ("right", slice(2, 4), slice(6, 8)),
    ("bottom left", slice(4, 6), slice(0, 2)),
    ("bottom", slice(4, 6), slice(2, 6)),
    ("bottom right", slice(4, 6), slice(6, 8)),
)
EDGES = (  # three regions that are one edge of the picture
    ("left", ("top left", "left", "bottom left")),
    ("right", ("top right", "right", "bottom right")),
    ("top", ("top left", "top", "top right")),
    ("bottom", ("bottom left", "bottom", "bottom right")),
)
SIDES = frozenset(name for _, names in EDGES[:2] for name in names)
ENOUGH = 0.6  # of the cells: what careful calibrations with 13 to 30 views reach and more
LEANING = 0.2  # sine of the lean, 12 degrees, from which the board counts as tilted to a side
SIZE_RATIO = 1.25  # between the nearest and the farthest board
NEW = 0.2  # summed change of place, size and lean from which a view is a new one; as in ROS's calibrator
NEW_CELLS = 3  # or it has corners in so many cells that were empty
SAME = 0.06  # but not where it hardly moved: corners at the border of cells jitter into new ones


class Tilt(StrEnum):
    """How a board leans, named by its edge, as the picture shows it, that is nearer to the camera."""

    FLAT = "flat"
    LEFT = "left"
    RIGHT = "right"
    UP = "up"
    DOWN = "down"


class Coverage:
    """What the views of one camera cover.

    Args:
        size: width and height of the camera's pictures, px.
        board: what the views show.
    """

    def __init__(self, size: tuple[int, int], board: KnownPoints) -> None:
        self.size = size
        self.board = board
        self.views = 0
        self.placements: list[Placement] = []
        self.cells: Ints = np.zeros((ROWS, COLUMNS), np.int32)
        """(rows, columns): how many views have a corner in each cell of the picture."""

    def add(self, view: BoardView) -> None:
        """Count a view in."""
        self.views += 1
        self.cells += self._cells_of(view)
        placement = place(view, self.board, self.size)
        if placement is not None:
            self.placements.append(placement)

    def is_new(self, view: BoardView) -> bool:
        """Whether the view shows the board at a place, distance or tilt that no view before did."""
        placement = place(view, self.board, self.size)
        opened = int(np.count_nonzero(self._cells_of(view) > self.cells))
        if placement is None:  # a small part of a board: all that it can bring is corners where none were
            return opened >= NEW_CELLS
        # Up to the first view there is nothing to be near to.
        nearest = min((_difference(placement, other) for other in self.placements), default=np.inf)
        return bool(nearest >= NEW or (nearest >= SAME and opened >= NEW_CELLS))

    @property
    def share(self) -> float:
        """Share of the cells that have a corner in at least one view."""
        return float(np.count_nonzero(self.cells) / self.cells.size)

    @property
    def tilts(self) -> frozenset[Tilt]:
        """Which ways of leaning were seen; a board that leans across counts for two."""
        return frozenset(tilt for placement in self.placements for tilt in tilts_of(placement))

    @property
    def sizes(self) -> tuple[float, float]:
        """The smallest and the largest `Placement.size`, as shares of the picture; (0, 0) before the first view."""
        sizes = [placement.size for placement in self.placements]
        return (min(sizes), max(sizes)) if sizes else (0.0, 0.0)

    def missing_regions(self) -> list[str]:
        """Names of the parts of the picture, "top left" to "bottom right", in which no view has a corner."""
        return [name for name, rows, columns in REGIONS if not self.cells[rows, columns].any()]

    def missing(self, excused: Collection[str] = ()) -> list[str]:
        """What a good calibration still lacks, in words, the most useful first; empty when nothing does.

        Args:
            excused: regions that need no corner, by name.
        """
        if not self.views:
            return ["no view of the board"]
        lacks = [
            f"the board was never tilted {names[0]} or {names[1]}"
            for names in ((Tilt.LEFT, Tilt.RIGHT), (Tilt.UP, Tilt.DOWN))
            if not self.tilts & set(names)
        ]
        empty = [name for name in self.missing_regions() if name not in excused]
        if "middle" in empty:
            lacks.append("no corner in the middle of the picture")
        for edge, names in EDGES:
            if all(name in empty for name in names):
                lacks.append(f"no corner near the {edge} edge of the picture")
        whole = {name for _, names in EDGES if all(name in empty for name in names) for name in names}
        lacks += [
            f"no corner near the {name} of the picture" for name in empty if name != "middle" and name not in whole
        ]
        if not empty and self.share < ENOUGH:
            lacks.append(f"corners in {self.share:.0%} of the picture, {ENOUGH:.0%} are wanted")
        smallest, largest = self.sizes
        if largest < SIZE_RATIO * smallest:
            lacks.append(f"the board was always at about the same distance: bring it {_closer(smallest)}")
        return lacks

    def _cells_of(self, view: BoardView) -> Ints:
        """(rows, columns): 1 where the view has a corner."""
        cells: Ints = np.zeros((ROWS, COLUMNS), np.int32)
        at = np.floor((view.corners + 0.5) / np.array(self.size) * (COLUMNS, ROWS)).astype(int)
        at = np.clip(at, 0, (COLUMNS - 1, ROWS - 1))
        cells[at[:, 1], at[:, 0]] = 1
        return cells


def missing_in_both(left: Coverage, right: Coverage) -> tuple[list[str], list[str]]:
    """What each camera's views lack, where every board must be seen by both cameras.

    A board that stands at the left edge of the right picture is some way inside the left one and cannot go farther.
    So no corner is asked for at a side of one picture where the other has some already.
    """
    empty = set(left.missing_regions()), set(right.missing_regions())
    excused = SIDES - empty[1], SIDES - empty[0]
    return left.missing(excused[0]), right.missing(excused[1])


def tilts_of(placement: Placement) -> set[Tilt]:
    """The tilts that one way of holding the board counts for."""
    found = set()
    if abs(placement.lean_x) >= LEANING:
        found.add(Tilt.RIGHT if placement.lean_x > 0 else Tilt.LEFT)
    if abs(placement.lean_y) >= LEANING:
        found.add(Tilt.DOWN if placement.lean_y > 0 else Tilt.UP)
    return found or {Tilt.FLAT}


def _difference(one: Placement, other: Placement) -> float:
    """How differently the board is held: changes of the middle, of the size and of the lean, added up."""
    return (
        abs(one.x - other.x)
        + abs(one.y - other.y)
        + abs(one.size - other.size)
        + abs(one.lean_x - other.lean_x) / 2  # a sine runs from -1 to 1
        + abs(one.lean_y - other.lean_y) / 2
    )


def _closer(size: float) -> str:
    """Which way to go from boards that fill this share of the picture."""
    return "closer" if size < 0.5 else "farther away"
