"""Why pairs do not agree on one rig: shifted lists, mirrored pictures, cameras that moved; in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stereo_gpu.boards.board import Board
from stereo_gpu.boards.board_pairs import FEWEST_IN_BOTH, FEWEST_PAIRS, BoardPair
from stereo_gpu.calibration.lenses import Lens
from stereo_gpu.calibration.movement import find_split
from stereo_gpu.calibration.pairing import LensView, Proposals, propose
from stereo_gpu.types import Doubles

SHIFTS = (1, -1, 2, -2, 3, -3)
BETTER = 5.0  # the right explanation lets boards, carried over, fit so many times better


def explain_mismatch(
    pairs: Sequence[BoardPair], lenses: tuple[Lens, Lens], board: Board, width: int, limit_px: float
) -> str | None:
    """Why the pairs do not agree, and the way out; None where nothing that is known explains it.

    Args:
        pairs: all of them; those in use are those of `lenses`.
        lenses: both cameras, each calibrated by itself.
        board: what the pictures show.
        width: of the right pictures, px.
        limit_px: error of a board carried over with another view's R and T, from which pairs do not belong together.
    """
    left, right = lenses
    numbers = [number for number, pair in enumerate(pairs) if not pair.reason]
    as_given = propose(left.views, right.views, board, right.matrix, right.distortion)
    enough = min(limit_px, _fit(as_given) / BETTER)
    for shift in SHIFTS:
        at = dict(zip(numbers, right.views, strict=True))
        together = [
            (ours, at[number + shift])
            for number, ours in zip(numbers, left.views, strict=True)
            if number + shift in at and _overlap(ours, at[number + shift])
        ]
        if len(together) > FEWEST_PAIRS:
            ours, theirs = zip(*together, strict=True)
            if _fit(propose(ours, theirs, board, right.matrix, right.distortion)) < enough:
                return _shifted(pairs, shift)
    mirrored = [_mirrored(view, board, width) for view in right.views]
    matrix, distortion = _mirrored_lens(right, width)
    proposals = propose(left.views, mirrored, board, matrix, distortion)
    if _fit(proposals) < enough:
        agreement = proposals.agreement()
        # Which of the two it is shows in where the right camera then stands.
        side = "right" if (agreement.R.T @ agreement.T)[0] < 0 else "left"
        return (
            f"the {side} camera's pictures are mirrored, the other's are not: turn mirroring off in the {side} camera,"
            " or flip all of its pictures from left to right"
        )
    split = find_split(as_given)
    return None if split is None else moved(pairs, split)


def moved(pairs: Sequence[BoardPair], first: int, detail: str = "") -> str:
    """That the cameras moved before the pair of number `first` among those used, with both groups."""
    used = [pair for pair in pairs if not pair.reason]
    before, after = used[first - 1], used[first]
    one, other = (pairs[0].number, before.number), (after.number, pairs[-1].number)
    return (
        f"the cameras moved{detail} between {before.names[0]} and {after.names[0]}: pairs {one[0]} to {one[1]} agree on"
        f" one rig, {other[0]} to {other[1]} on another; calibrate with those that were taken as the cameras stand now"
        f" (--pairs {one[0]}-{one[1]} or --pairs {other[0]}-{other[1]})"
    )


def _shifted(pairs: Sequence[BoardPair], shift: int) -> str:
    """That left i belongs to right i + shift."""
    many, ends = "one picture", ("picture", "last")
    if abs(shift) > 1:
        many, ends = f"{abs(shift)} pictures", (f"{abs(shift)} pictures", f"last {abs(shift)}")
    number = max(0, -shift)
    left, right = pairs[number].names[0], pairs[number + shift].names[1]
    early, late = ("right", "left") if shift > 0 else ("left", "right")
    return (
        f"the lists are shifted by {many}: {left} belongs with {right}, and so on; leave out the first {ends[0]}"
        f" of the {early} camera and the {ends[1]} of the {late} one"
    )


def _fit(proposals: Proposals) -> float:
    """Median error of the best proposal, px, over the views that did not make it."""
    errors = proposals.errors_px.min(axis=2)
    own = proposals.view[:, None] == np.arange(errors.shape[1])
    return float(np.nanmedian(np.where(own, np.nan, errors), axis=1).min())


def _overlap(left: LensView, right: LensView) -> bool:
    return bool(len(np.intersect1d(left.seen.ids, right.seen.ids)) >= FEWEST_IN_BOTH)


def _mirrored(view: LensView, board: Board, width: int) -> LensView:
    """The view as the camera would have given it without mirroring, or with.

    A mirrored plane still looks like a plane: the finder lists its columns from the other end, so that its corners
    go round clockwise, as always. Undone, the board lies as if turned over on its far side.
    """
    columns, rows = board.corners
    turned = np.arange(columns * rows).reshape(rows, columns)[:, ::-1].reshape(-1)
    ids = turned[view.seen.ids].astype(np.int32)
    rising = np.argsort(ids)
    corners = view.seen.corners.copy()
    corners[:, 0] = width - 1 - corners[:, 0]
    flip = np.diag([-1.0, 1.0, 1.0])
    # Point (x, y) of the board is now called (end - x, y): X' = M (R (end - x, y) + t).
    end = np.array([board.points[columns - 1, 0], 0.0, 0.0], np.float64)
    return replace(
        view,
        seen=replace(view.seen, corners=corners[rising], ids=ids[rising]),
        rotation=flip @ view.rotation @ flip,
        translation=flip @ (view.rotation @ end + view.translation),
    )


def _mirrored_lens(lens: Lens, width: int) -> tuple[Doubles, Doubles]:
    """Camera matrix and distortion behind mirrored pictures: x changes its sign, and so do p2, s1 and s2."""
    matrix, distortion = lens.matrix.copy(), lens.distortion.copy()
    matrix[0, 2] = width - 1 - matrix[0, 2]
    distortion[3] *= -1
    distortion[8:10] *= -1
    return matrix, distortion
