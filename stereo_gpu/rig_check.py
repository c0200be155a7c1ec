"""Is this rig still good? The rows of matched features of a raw pair tell, and what is wrong if it is not."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.epipolar.consensus import ENOUGH, agree_without_rig, agreeing, enough
from stereo_gpu.epipolar.drift import drifted, fit_drift
from stereo_gpu.epipolar.error_map import ErrorMap, map_errors
from stereo_gpu.epipolar.faults import BEHIND, Explanation, Fault, explain, share_behind
from stereo_gpu.epipolar.features import WORKING_SIDE
from stereo_gpu.epipolar.rows import Rows, find_rows, focal_length, rays
from stereo_gpu.epipolar.sharpen import match_sharply
from stereo_gpu.errors import InputError
from stereo_gpu.images import check_pair
from stereo_gpu.rectify import check_sizes, plan_rectification
from stereo_gpu.rig import Camera, Rig
from stereo_gpu.types import Doubles, Picture, RectifiedPair

WARN_PX, REFUSE_PX = 0.5, 2.0  # median vertical error
STRAY_PX, STRAY = 1.0, 6.0  # px, and times the median: farther from what a drift explains lies no true match
MOST = 1000  # matches that the fault is told from; more add time alone
SURE = 2 * ENOUGH  # features from which on another's rig is told from a repeated pattern, matched one period off
SMALL_SHARE = 0.15  # of the frame's cells with features, below which the verdict says that it holds for a part


class Verdict(StrEnum):
    """How good a rig is for a pair."""

    GOOD = "good"
    DOUBTFUL = "doubtful"  # rows differ by so much that matches are lost
    BAD = "bad"  # not worth matching
    UNKNOWN = "unknown"  # too few features to tell


@dataclass(frozen=True, kw_only=True, eq=False)
class RigCheck:
    """What matched features tell of a rig and a raw pair.

    Args:
        matches: how many features were matched.
        vertical_px: median distance between the rows of matched features that agree; NaN where nothing is concluded.
        vertical_95_px: 95 % of them differ by no more.
        bias_px: median of row in the left picture less row in the right one; above 0 the right picture lies higher.
        behind: share of them that would lie behind the cameras.
        verdict: in a word; says: in words, with the way out.
        fault: what explains the errors, and `amount` of it: px of a shift down and degrees of a clockwise rotation of
            the right picture against the left one, per cent by which the right one is larger, degrees of a turn.
        map: errors over the left picture.
        points_left, points_right: (N, 2) px in the raw pictures, the matches that agree.
        vertical: (N,) px, their vertical errors.
        size: width and height of the pictures.
    """

    matches: int
    vertical_px: float
    vertical_95_px: float
    bias_px: float
    behind: float
    verdict: Verdict
    says: str
    fault: Fault
    amount: float
    map: ErrorMap
    points_left: Doubles
    points_right: Doubles
    vertical: Doubles
    size: tuple[int, int]

    @property
    def swapped(self) -> bool:
        """Whether left and right look exchanged."""
        return self.fault is Fault.SWAPPED

    def record(self) -> dict[str, Any]:
        """All numbers, for JSON; null where one is not known."""
        return {
            "verdict": str(self.verdict),
            "says": self.says,
            "fault": str(self.fault),
            "amount": _known(self.amount),
            "matches": self.matches,
            "used": len(self.vertical),
            "vertical_px": _known(self.vertical_px),
            "vertical_95_px": _known(self.vertical_95_px),
            "bias_px": _known(self.bias_px),
            "behind": _known(self.behind),
            "frame_share": self.map.share,
            "map_px": [[_known(value) for value in row] for row in self.map.values.tolist()],
            "map_counts": self.map.counts.tolist(),
        }


def check_rig(left: Picture, right: Picture, rig: Rig, *, matches: tuple[Doubles, Doubles] | None = None) -> RigCheck:
    """Say whether a rig is still good, from a raw pair: matched SIFT features must lie on the rows that it gives.

    Args:
        left, right: raw pictures of the rig's cameras, (H, W) or (H, W, 3), uint8 or uint16.
        rig: the calibrated pair of cameras.
        matches: (N, 2) px each, what `match_sharply` finds in this very pair, if that is known already.

    Returns:
        The errors over the frame, what explains them, and the verdict: good up to a median error of 0.5 px, bad
        above 2 px or if nearly all points lie behind the cameras, unknown with too few features.

    Raises:
        InputError: the pictures do not fit each other or the rig, or are one and the same.
    """
    check_pair(left, right)
    check_sizes(left, rig)
    plan_rectification(rig)  # refuses cameras that stand above each other
    points_left, points_right = match_sharply(left, right) if matches is None else matches
    matched, size = len(points_left), (left.shape[1], left.shape[0])
    if matched and np.array_equal(left, right):
        raise InputError("both pictures are one and the same: give one of each camera")
    focal = focal_length(rig)
    scale = max(1.0, max(size) / WORKING_SIDE)
    sides = rays(points_left, rig.left), rays(points_right, rig.right)
    rows = find_rows(*sides, rig.R, rig.T, focal)
    good = agreeing(rows, focal, scale=scale)
    if not enough(good):
        other = agree_without_rig(points_left, points_right, scale)
        return _no_rows(matched, int(good.sum()), size, other=other)
    some = _spread(good)
    drift, _ = fit_drift(sides[0][some], sides[1][some], rig, focal)
    moved = drifted(rig, drift)
    # Wrong matches that come near a row by chance stray from the rest, whatever is wrong with the rig.
    rest = np.abs(find_rows(*sides, moved.R, moved.T, focal).vertical)
    good &= rest <= max(STRAY_PX * scale, STRAY * float(np.median(rest[good])))
    some = _spread(good)
    found = explain(points_left[some], points_right[some], rig, drift)
    points_left, points_right = points_left[good], points_right[good]
    rows = Rows(vertical=rows.vertical[good], disparity=rows.disparity[good], at=rows.at[good])
    errors = np.abs(rows.vertical)
    error = float(np.median(errors))
    cells = map_errors(points_left, rows.vertical, size)
    behind = share_behind(rows)
    verdict = _judge(error, len(errors), found.fault, behind)
    return RigCheck(
        matches=matched,
        vertical_px=error,
        vertical_95_px=float(np.percentile(errors, 95)),
        bias_px=float(np.median(rows.vertical)),
        behind=behind,
        verdict=verdict,
        says=_in_words(verdict, found, error, len(errors), cells.share),
        fault=found.fault,
        amount=found.amount,
        map=cells,
        points_left=points_left,
        points_right=points_right,
        vertical=rows.vertical,
        size=size,
    )


def unchecked(size: tuple[int, int]) -> RigCheck:
    """What is known of a rig that was not checked, with pictures of this width and height."""
    nothing, none = np.zeros((0, 2)), float("nan")
    return RigCheck(
        matches=0,
        vertical_px=none,
        vertical_95_px=none,
        bias_px=none,
        behind=none,
        verdict=Verdict.UNKNOWN,
        says="the rig was not checked against this pair",
        fault=Fault.NONE,
        amount=none,
        map=map_errors(nothing, np.zeros(0), size),
        points_left=nothing,
        points_right=nothing,
        vertical=np.zeros(0),
        size=size,
    )


def ideal_rig(pair: RectifiedPair) -> Rig:
    """The rig whose raw pictures a rectified pair's would be, for `check_rig`."""
    height, width = pair.left.shape[:2]
    cameras = [
        Camera(np.array([[pair.focal_px, 0, cx], [0, pair.focal_px, pair.cy], [0, 0, 1]]), np.zeros(5), (width, height))
        for cx in (pair.cx_left, pair.cx_right)
    ]
    return Rig(cameras[0], cameras[1], np.eye(3), np.array([-pair.baseline, 0, 0]), unit=pair.unit)


def refuse_bad(checked: RigCheck) -> None:
    """Refuse a pair that is not worth matching with this rig.

    Raises:
        InputError: with what is wrong, and the way out.
    """
    if checked.verdict is Verdict.BAD:
        raise InputError(f"{checked.says}; or go on all the same with --ignore-check (ignore_check=True)")


def refuse_swapped(checked: RigCheck) -> None:
    """Refuse swapped pictures, whatever else is wrong.

    Raises:
        InputError: with the share of points that would lie behind the cameras.
    """
    if checked.swapped:
        raise InputError(checked.says)


def _spread(good: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Numbers of MOST good matches or fewer: the points are sorted by place, so that every n-th are spread as all."""
    known = np.flatnonzero(good)
    return known[:: -(-len(known) // MOST)]


def _judge(error: float, features: int, fault: Fault, behind: float) -> Verdict:
    """The verdict on a median error, px: its cause does not make it worse unless points lie behind the cameras."""
    if fault is Fault.SWAPPED or behind > BEHIND:
        return Verdict.BAD
    if fault is Fault.OTHER_RIG and features < SURE:
        return Verdict.UNKNOWN
    if error > REFUSE_PX:
        return Verdict.BAD
    return Verdict.DOUBTFUL if error > WARN_PX else Verdict.GOOD


def _in_words(verdict: Verdict, found: Explanation, error: float, features: int, share: float) -> str:
    """The error, its cause and the way out; `share` is that of the frame's cells with features."""
    where = "" if share >= SMALL_SHARE else f", which fill only {share:.0%} of the frame"
    says = f"rows differ by {error:.2f} px (median of {features} features{where})"
    if verdict is Verdict.UNKNOWN:
        return (
            f"{says}: {found.says}, or a pattern that repeats was matched wrongly, which {SURE} features would tell;"
            " take a pair with more texture that both cameras see"
        )
    if found.says:
        return f"{says}: {'good enough, but ' if verdict is Verdict.GOOD else ''}{found.says}; {found.mend}"
    return f"{says}: the rig is good" if verdict is Verdict.GOOD else says


def _no_rows(matches: int, used: int, size: tuple[int, int], *, other: bool) -> RigCheck:
    """The check of a pair whose matches do not agree on rows; `other` says that they agree without the rig."""
    says = (
        f"nothing can be said of the rig: of {matches} matched features {used} agree, {ENOUGH} and a quarter of all are"
        " needed; take a pair with more texture that both cameras see"
    )
    if other:
        says = (
            f"the rig belongs to other cameras: {matches} matched features agree with each other, but no more than"
            f" {used} of them with this rig or one like it; give these cameras' own rig, or calibrate again"
        )
    return replace(
        unchecked(size),
        matches=matches,
        verdict=Verdict.BAD if other else Verdict.UNKNOWN,
        says=says,
        fault=Fault.OTHER_RIG if other else Fault.NONE,
    )


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
