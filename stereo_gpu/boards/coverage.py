"""Which parts of the picture, distances and tilts the views of a board cover, and what is missing."""

from __future__ import annotations

from collections.abc import Collection
from enum import StrEnum

import numpy as np

from stereo_gpu.boards.board import BoardView
from stereo_gpu.boards.placement import KnownPoints, Placement, place
from stereo_gpu.types import Ints

COLUMNS, ROWS = 8, 6  # cells of the picture
REGIONS = (  # name, rows and columns of its cells: four corners, the outermost cells between them, and the middle
    ("top left", slice(0, 2), slice(0, 2)),
    ("top", slice(0, 1), slice(2, 6)),
    ("top right", slice(0, 2), slice(6, 8)),
    ("left", slice(2, 4), slice(0, 1)),
    ("middle", slice(2, 4), slice(2, 6)),
    ("right", slice(2, 4), slice(7, 8)),
    ("bottom left", slice(4, 6), slice(0, 2)),
    ("bottom", slice(5, 6), slice(2, 6)),
    ("bottom right", slice(4, 6), slice(6, 8)),
)
EDGES = (  # three regions that are one edge of the picture
    ("left", ("top left", "left", "bottom left")),
    ("right", ("top right", "right", "bottom right")),
    ("top", ("top left", "top", "top right")),
    ("bottom", ("bottom left", "bottom", "bottom right")),
)
SIDES = frozenset(name for _, names in EDGES[:2] for name in names)
ENOUGH = 0.6  # of the cells: the real calibrations of 13 and 30 views that this was tried on reach 67 to 79 %
LEANING = 0.2  # sine of the lean, 12 degrees, from which the board counts as tilted to a side
SIZE_RATIO = 1.25  # between the nearest and the farthest board
HALF = 0.5  # `Placement.size` from which a board is called near
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


TILT_AXES = (frozenset({Tilt.LEFT, Tilt.RIGHT}), frozenset({Tilt.UP, Tilt.DOWN}))


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
        return [said for said, _ in self._lacks(excused)]

    def next_step(self, excused: Collection[str] = ()) -> str:
        """What to do with the board next, such as "move it to the top left"; empty when nothing is missing."""
        return next((step for _, step in self._lacks(excused)), "")

    def progress(self, excused: Collection[str] = ()) -> float:
        """How much of what is wanted is there, 0..1; 1 when nothing is missing."""
        regions = sum(name not in self.missing_regions() or name in excused for name, *_ in REGIONS)
        others = sum(bool(self.tilts & axis) for axis in TILT_AXES) + self._near_and_far
        return (regions + others + min(1.0, self.share / ENOUGH)) / (len(REGIONS) + len(TILT_AXES) + 2)

    @property
    def _near_and_far(self) -> bool:
        smallest, largest = self.sizes
        return bool(smallest) and largest >= SIZE_RATIO * smallest

    def _lacks(self, excused: Collection[str]) -> list[tuple[str, str]]:
        """What is missing, and what to do about it."""
        if not self.views:
            return [("no view of the board", "show the board")]
        lacks = [
            (f"the board was never tilted {one} or {other}", f"tilt it {one} or {other}")
            for axis in TILT_AXES
            if not self.tilts & axis
            for one, other in [sorted(axis, key=list(Tilt).index)]
        ]
        empty = [name for name in self.missing_regions() if name not in excused]
        if "middle" in empty:
            lacks.append(("no corner in the middle of the picture", "move it to the middle"))
        edges = [(edge, names) for edge, names in EDGES if all(name in empty for name in names)]
        lacks += [
            (f"no corner near the {edge} edge of the picture", f"move it to the {edge} edge") for edge, _ in edges
        ]
        told = {"middle"}.union(*(names for _, names in edges))
        lacks += [
            (f"no corner near the {name} of the picture", f"move it to the {name}")
            for name in empty
            if name not in told
        ]
        if not empty and self.share < ENOUGH:
            # To the part with the largest share of cells without a corner.
            shares = {
                name: float((self.cells[rows, columns] == 0).mean())
                for name, rows, columns in REGIONS
                if name not in excused
            }
            said = f"corners in {self.share:.0%} of the picture, {ENOUGH:.0%} are wanted"
            lacks.append((said, f"move it to the {max(shares, key=lambda name: shares[name])}"))
        if not self._near_and_far:
            way = "closer" if self.sizes[0] < HALF else "farther away"
            lacks.append((f"the board was always at about the same distance: bring it {way}", f"bring it {way}"))
        return lacks

    def _cells_of(self, view: BoardView) -> Ints:
        """(rows, columns): 1 where the view has a corner."""
        cells: Ints = np.zeros((ROWS, COLUMNS), np.int32)
        at = np.floor((view.corners + 0.5) / np.array(self.size) * (COLUMNS, ROWS)).astype(int)
        at = np.clip(at, 0, (COLUMNS - 1, ROWS - 1))
        cells[at[:, 1], at[:, 0]] = 1
        return cells


def missing_in_both(left: Coverage, right: Coverage) -> tuple[list[str], list[str]]:
    """What the views of each camera lack, where both must see every board."""
    excused = out_of_reach(left, right)
    return left.missing(excused[0]), right.missing(excused[1])


def out_of_reach(left: Coverage, right: Coverage) -> tuple[frozenset[str], frozenset[str]]:
    """Regions at the sides of each picture that need no corner, where both cameras must see every board.

    A board that stands at the left edge of the right picture is some way inside the left one and cannot go farther.
    So nothing is asked for at a side of one picture where the other has a corner already.
    """
    return SIDES - set(right.missing_regions()), SIDES - set(left.missing_regions())


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
