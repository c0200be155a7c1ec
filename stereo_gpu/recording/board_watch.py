"""Watch both cameras for a board, and take a pair when it is still, sharp and where none was taken before."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from stereo_gpu.boards.board import Board, BoardView, in_both
from stereo_gpu.boards.pair_coverage import SIDES, PairCoverage
from stereo_gpu.boards.sharpness import REACH, edge_width
from stereo_gpu.errors import InputError
from stereo_gpu.images import grey
from stereo_gpu.recording.frames import StereoFrame
from stereo_gpu.recording.quick_find import QuickFinder, shrink
from stereo_gpu.types import Bytes, Ints, Picture

STILL_PX = 1.0  # of a picture 640 px wide: all that a still board may move
STILL_S = 0.25  # for so long; at these limits 10 ms between the cameras' pictures make 0.04 px
STILL_LOOKS = 3  # and in so many looks
SHARP_PX = 4.0  # of a picture up to 1280 px wide: edges of real, sharp boards are 2 to 3 px wide
SHARP_FACTOR = 1.3  # a camera that never gets sharper is taken as it is: up to so much wider than its best
SHARP_LOOKS = 30  # and known after so many still looks
MARKED_REACH = 0.1  # of a square: beyond it a marker may begin
FEWEST_COMMON = 6  # corners that both cameras see
BLANK_LOOKS = 25  # with no board in either picture, after which it may be another one than was said
DOUBTED_PAIRS = 5  # the first pairs, for which it is asked whether they show a part of a larger board
HINT_SIDE = 640  # px: the search for a board of any size is slow


@dataclass(frozen=True, kw_only=True)
class Look:
    """What the chooser made of one moment; for those who show it.

    Args:
        frame: both pictures.
        views: where the board was seen, left and right.
        status: one line, why the pair was taken or not.
        taken: whether it was.
        pairs: how many were so far.
        cells: of both cameras' `Coverage`.
        missing: what the views of each camera lack, in words.
        wanted: names of the regions of each picture that still need a corner.
        progress: 0..1, 1 when nothing is missing.
        done: whether it is enough.
    """

    frame: StereoFrame
    views: tuple[BoardView | None, BoardView | None]
    status: str
    taken: bool
    pairs: int
    cells: tuple[Ints, Ints]
    missing: tuple[list[str], list[str]]
    wanted: tuple[list[str], list[str]]
    progress: float
    done: bool


class BoardChooser:
    """Takes a pair when the board is found in both pictures, held still, sharp, and at a new place or tilt.

    Args:
        board: what to look for.
        still: whether to wait until the board holds still; not among single pictures, each of another pose.
        shows: told of every look, such as a page and a map on the terminal.
    """

    def __init__(self, board: Board, *, still: bool = True, shows: Sequence[Callable[[Look], None]] = ()) -> None:
        self._board = board
        self._shows = tuple(shows)
        self._coverage: PairCoverage | None = None  # until the first picture says its size
        self._finders = QuickFinder(board), QuickFinder(board)
        self._motions = (_Motion(board), _Motion(board)) if still else ()
        self._edges = _Edges(board), _Edges(board)
        self._blank = 0
        self._hint = ""
        self._status = "waiting for the first pictures"

    def choose(self, frame: StereoFrame) -> bool:
        """Whether to take this pair; shows the look to all who want it.

        Raises:
            InputError: the pictures changed their size.
        """
        coverage = self._coverage_of(frame.left)
        flats = grey(frame.left), grey(frame.right)
        views = self._finders[0].find(flats[0]), self._finders[1].find(flats[1])
        self._status, taken = self._judge(frame, flats, views, coverage)
        if self._shows:
            look = Look(
                frame=frame,
                views=views,
                status=self._status,
                taken=taken,
                pairs=coverage.pairs,
                cells=(coverage.cameras[0].cells.copy(), coverage.cameras[1].cells.copy()),
                missing=coverage.missing(),
                wanted=coverage.wanted_regions(),
                progress=coverage.progress,
                done=coverage.done,
            )
            for show in self._shows:
                show(look)
        return taken

    def count_in(self, left: Picture, right: Picture) -> bool:
        """Count in a pair that was taken before, so that none like it is taken again; False if it shows no board.

        Raises:
            InputError: its pictures differ in size from those before.
        """
        coverage = self._coverage_of(left)
        views = self._finders[0].find(grey(left)), self._finders[1].find(grey(right))
        if views[0] is None or views[1] is None:
            return False
        coverage.add(views[0], views[1])
        return True

    @property
    def done(self) -> bool:
        """Whether both cameras' views cover enough."""
        return self._coverage is not None and self._coverage.done

    @property
    def status(self) -> str:
        """Why no pair is taken now, or that one was."""
        return self._status

    @property
    def coverage(self) -> PairCoverage | None:
        """What was taken so far; None before the first picture."""
        return self._coverage

    def _coverage_of(self, picture: Picture) -> PairCoverage:
        size = picture.shape[1], picture.shape[0]
        if self._coverage is None:
            self._coverage = PairCoverage(size, self._board)
        before = self._coverage.size
        if before != size:
            raise InputError(
                f"the pictures changed from {before[0]} x {before[1]} to {size[0]} x {size[1]} px: start again, with"
                " one size for the whole calibration"
            )
        return self._coverage

    def _judge(
        self,
        frame: StereoFrame,
        flats: tuple[Bytes, Bytes],
        views: tuple[BoardView | None, BoardView | None],
        coverage: PairCoverage,
    ) -> tuple[str, bool]:
        """The reason, and whether to take it: the quick tests first, and the first that fails says why not."""
        held_s = [motion.held_s(view, frame) for motion, view in zip(self._motions, views, strict=False)]
        left, right = views
        if left is None or right is None:
            return self._unseen(flats[0], views), False
        self._blank, self._hint = 0, ""
        if min(held_s, default=STILL_S) < STILL_S:
            return "hold still", False
        # Both are asked, since each gathers what its camera can do.
        blurs = self._edges[0].complaint(flats[0], left), self._edges[1].complaint(flats[1], right)
        for side, blur in zip(SIDES, blurs, strict=True):
            if blur:
                return f"the {side} picture is {blur}", False
        if not coverage.is_new(left, right):
            return f"already have one here: {coverage.next_step()}", False
        # Only now the search at full size, which is what the calibration will see.
        found = self._board.find(frame.left), self._board.find(frame.right)
        if found[0] is None or found[1] is None:
            side = SIDES[0 if found[0] is None else 1]
            return f"the board is hard to see in the {side} picture: bring it closer or into better light", False
        # A finder that was told too few squares finds a part of the board, and seldom the same one in both cameras.
        other = self._board.hint(shrink(flats[0], HINT_SIDE), found[0]) if coverage.pairs < DOUBTED_PAIRS else None
        if other is not None:
            return other.text, False
        if len(in_both(found[0], found[1])[0].ids) < FEWEST_COMMON:
            return "the cameras see different parts of the board: move it to where both look", False
        coverage.add(found[0], found[1])
        return "taken: that is enough" if coverage.done else f"taken: now {coverage.next_step()}", True

    def _unseen(self, flat: Bytes, views: tuple[BoardView | None, BoardView | None]) -> str:
        missed = [side for side, view in zip(SIDES, views, strict=True) if view is None]
        if len(missed) == 1:
            self._blank = 0
            return f"the {missed[0]} camera does not see the board: move it to where both look"
        self._blank += 1
        if self._blank % BLANK_LOOKS == 0:
            hint = self._board.hint(shrink(flat, HINT_SIDE), None)
            self._hint = "" if hint is None else hint.text
        return self._hint or f"show the board of {self._board} squares to both cameras"


class _Motion:
    """How long a board has not moved in one camera's pictures."""

    def __init__(self, board: Board) -> None:
        self._turnable = len(board.turns) > 1
        self._rest: BoardView | None = None  # where it was when it came to rest
        self._since_s = 0.0
        self._looks = 0

    def held_s(self, view: BoardView | None, frame: StereoFrame) -> float:
        """Seconds; 0 where the board was not seen, or in too few looks."""
        if view is None:
            self._rest = None
            return 0.0
        limit = STILL_PX * max(1.0, frame.left.shape[1] / 640)
        # Compared with where it came to rest rather than with the last look, so that a slow drift is seen.
        if self._rest is None or self._moved(self._rest, view) > limit:
            self._rest, self._since_s, self._looks = view, frame.time_s, 0
        self._looks += 1
        return frame.time_s - self._since_s if self._looks >= STILL_LOOKS else 0.0

    def _moved(self, before: BoardView, now: BoardView) -> float:
        """The longest way of a corner, px."""
        if self._turnable:
            # The finder may start at the board's other end each time: to the nearest corner of before.
            from scipy.spatial import cKDTree

            return float(cKDTree(before.corners).query(now.corners)[0].max())
        before, now = in_both(before, now)
        ways = np.linalg.norm(before.corners - now.corners, axis=1)
        return float(ways.max()) if len(ways) else np.inf


class _Edges:
    """Whether a board is sharp in one camera's pictures, by itself and against the best that the camera showed."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._reach = MARKED_REACH if len(board.turns) == 1 else REACH
        self._best = np.inf
        self._looks = 0

    def complaint(self, flat: Bytes, view: BoardView) -> str:
        """What is wrong, with the way out; "" if nothing is."""
        width = edge_width(flat, view, self._board, self._reach)
        if not np.isfinite(width):
            return "too dim: more light"
        self._looks += 1
        self._best = min(self._best, width)
        limit = SHARP_PX * max(1.0, flat.shape[1] / 1280)
        if self._looks > SHARP_LOOKS:
            limit = max(limit, SHARP_FACTOR * self._best)
        return "" if width <= limit else f"too blurred (edges {width:.1f} px wide): more light, or focus the camera"
