"""What the views of two cameras cover that must see every board together, and what to do next."""

from __future__ import annotations

from stereo_gpu.boards.board import BoardView
from stereo_gpu.boards.coverage import Coverage, missing_in_both, out_of_reach
from stereo_gpu.boards.placement import KnownPoints

FEWEST_PAIRS = 10  # however much of the pictures fewer of them cover
SIDES = ("left", "right")


class PairCoverage:
    """The coverage of both cameras.

    Args:
        size: width and height of the pictures, px.
        board: what the views show.
    """

    def __init__(self, size: tuple[int, int], board: KnownPoints) -> None:
        self.size = size
        self.cameras = Coverage(size, board), Coverage(size, board)
        self.pairs = 0

    def add(self, left: BoardView, right: BoardView) -> None:
        """Count a pair in."""
        self.pairs += 1
        self.cameras[0].add(left)
        self.cameras[1].add(right)

    def is_new(self, left: BoardView, right: BoardView) -> bool:
        """Whether either camera sees the board as it has not yet."""
        return self.cameras[0].is_new(left) or self.cameras[1].is_new(right)

    def missing(self) -> tuple[list[str], list[str]]:
        """What the views of the left and of the right camera lack, in words."""
        return missing_in_both(*self.cameras)

    def wanted_regions(self) -> tuple[list[str], list[str]]:
        """Names of the regions of the left and of the right picture that still need a corner."""
        left, right = (
            [name for name in camera.missing_regions() if name not in names]
            for camera, names in zip(self.cameras, out_of_reach(*self.cameras), strict=True)
        )
        return left, right

    @property
    def done(self) -> bool:
        """Whether nothing is missing, in at least ten pairs."""
        return self.pairs >= FEWEST_PAIRS and self.missing() == ([], [])

    @property
    def progress(self) -> float:
        """How much of what is wanted is there, 0..1; 1 when it is done."""
        excused = out_of_reach(*self.cameras)
        shares = [camera.progress(names) for camera, names in zip(self.cameras, excused, strict=True)]
        return (sum(shares) + min(1.0, self.pairs / FEWEST_PAIRS)) / 3

    def next_step(self) -> str:
        """What to do with the board next, for the camera that lacks more."""
        missing, excused = self.missing(), out_of_reach(*self.cameras)
        side = 0 if len(missing[0]) >= len(missing[1]) else 1
        step = self.cameras[side].next_step(excused[side])
        if step.startswith("move it to"):
            step += f" of the {SIDES[side]} picture"
        return step or "hold it at another place or tilt"


def by_picture(missing: tuple[list[str], list[str]]) -> list[tuple[str, list[str]]]:
    """What is missing in "both pictures", the "left picture" and the "right picture", without those that lack nothing.

    Args:
        missing: of the left and of the right camera, as `PairCoverage.missing` gives it.
    """
    both = [lack for lack in missing[0] if lack in missing[1]]
    parts = [("both pictures", both)]
    parts += [
        (f"{side} picture", [lack for lack in own if lack not in both])
        for side, own in zip(SIDES, missing, strict=True)
    ]
    return [(where, lacks) for where, lacks in parts if lacks]
