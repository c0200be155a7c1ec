"""What is wrong with a pair or its rig, told from the vertical errors of matched points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from stereo_gpu.epipolar.drift import Drift, drifted
from stereo_gpu.epipolar.least_squares import fit_softly
from stereo_gpu.epipolar.rows import Rows, find_rows, focal_length, rays
from stereo_gpu.rig import Camera, Rig
from stereo_gpu.types import Doubles

BEHIND = 0.8  # share of the matches behind the cameras from which on the pictures look swapped
BEHIND_PX = 1.0
EXPLAINED_PX, EXPLAINED = 0.25, 1.5  # a simple fault leaves no more than this, or than so many times a drift's rest
MOST_OF_IT = 0.1  # or this share of the error, if no large turn would be needed
WORTH_PX, WORTH = 0.15, 0.6  # a fault is named if it takes away so much of the error, and to this share of it
FAR_DEG = 1.0  # cameras that turned by more cannot be told from others
UNEXPLAINED_PX = 0.5
LARGEST = 50.0  # times the unit of a fit: 50 px, 10 degrees, half the size


class Fault(StrEnum):
    """What explains the vertical errors."""

    NONE = "none"
    SWAPPED = "swapped"
    SHIFTED = "shifted"
    ROTATED = "rotated"
    SCALED = "scaled"
    MOVED = "moved"
    OTHER_RIG = "other rig"
    SCATTERED = "scattered"


@dataclass(frozen=True, kw_only=True, eq=False)
class Explanation:
    """A fault in words.

    Args:
        fault: which.
        amount: px of a shift, degrees of a rotation or turn, per cent of a scale; NaN for the others.
        says: what it is; mend: the way out. Empty for no fault.
        rest: (N,) px, the vertical errors once it is allowed for.
    """

    fault: Fault
    amount: float = float("nan")
    says: str = ""
    mend: str = ""
    rest: Doubles


def explain(points_left: Doubles, points_right: Doubles, rig: Rig, drift: Drift) -> Explanation:
    """Find what explains the vertical errors of matched points.

    Every fault that one number describes - a picture shifted, rotated or scaled against the other - is fitted. The
    simplest that explains the errors is named: shift, rotation and scale before the drift of a camera, which has five
    numbers.

    Args:
        points_left, points_right: (N, 2) px in the raw pictures, true matches, at least 5.
        rig: as it was calibrated.
        drift: what `fit_drift` found for these points.
    """
    focal = focal_length(rig)
    sides = rays(points_left, rig.left), rays(points_right, rig.right)
    rows = find_rows(*sides, rig.R, rig.T, focal)
    moved = drifted(rig, drift)
    rest = find_rows(*sides, moved.R, moved.T, focal).vertical
    if share_behind(rows) > BEHIND:
        return _behind(points_left, points_right, rig, rows, rest)
    error, least = _median(rows.vertical), _median(rest)
    if error - least < WORTH_PX or least > WORTH * error:
        if error <= UNEXPLAINED_PX:
            return Explanation(fault=Fault.NONE, rest=rest)
        return Explanation(
            fault=Fault.SCATTERED,
            says="the rows differ without a pattern that a turned camera or a changed picture would make",
            mend="take both pictures at one moment, sharp and without motion",
            rest=rest,
        )
    enough = max(EXPLAINED_PX, EXPLAINED * least)
    if drift.turn_deg <= FAR_DEG:
        # A calibration that was not perfect before leaves more.
        enough = max(enough, MOST_OF_IT * error)
    simple = [fitted for fitted in _simple(points_left, points_right, rig, focal) if _median(fitted.rest) <= enough]
    if simple:
        return min(simple, key=lambda fitted: float(np.fmin(np.abs(fitted.rest), 1.0).sum()))
    return _moved(drift, rest, error)


def share_behind(rows: Rows) -> float:
    """Share of the matches that would lie behind the cameras."""
    return float((rows.disparity < -BEHIND_PX).mean())


def _simple(points_left: Doubles, points_right: Doubles, rig: Rig, focal: float) -> list[Explanation]:
    """The faults of one number, each fitted to the errors."""
    degree = focal * np.pi / 180

    def left_by(**change: float) -> Doubles:
        changed = rays(_undone(points_left, rig.left, **change), rig.left)
        return find_rows(changed, right_rays, rig.R, rig.T, focal).vertical

    def right_by(**change: float) -> Doubles:
        changed = rays(_undone(points_right, rig.right, **change), rig.right)
        return find_rows(left_rays, changed, rig.R, rig.T, focal).vertical

    left_rays, right_rays = rays(points_left, rig.left), rays(points_right, rig.right)
    down, rest = _fit(lambda number: right_by(down=number), 1.0)
    lower, higher = ("right", "left") if down > 0 else ("left", "right")
    found = [
        Explanation(
            fault=Fault.SHIFTED,
            amount=down,
            says=f"the {lower} picture is shifted down by {abs(down):.1f} px against the {higher} one, or a camera"
            f" pitched by {abs(down) / degree:.2f} degrees",
            mend="give both as the cameras take them, or correct the pitch with `stereo-gpu check --refine`",
            rest=rest,
        )
    ]
    for name, other, change in (("right", "left", right_by), ("left", "right", left_by)):
        turned, rest = _fit(lambda number, change=change: change(turned=number), 0.2)  # type: ignore[misc]
        found.append(
            Explanation(
                fault=Fault.ROTATED,
                # Of the right picture, clockwise.
                amount=turned if name == "right" else -turned,
                says=f"the {name} picture is rotated by {abs(turned):.2f} degrees"
                f" {'clockwise' if turned > 0 else 'anticlockwise'} against the {other} one",
                mend="give both as the cameras take them, or correct the roll with `stereo-gpu check --refine`",
                rest=rest,
            )
        )
        larger, rest = _fit(lambda number, change=change: change(larger=number), 0.01)  # type: ignore[misc]
        found.append(
            Explanation(
                fault=Fault.SCALED,
                amount=100 * (larger if name == "right" else -larger),
                says=f"the {name} picture is {'larger' if larger > 0 else 'smaller'} by {100 * abs(larger):.1f} % than"
                f" the {other} one, as if zoom or focus changed",
                mend="give both as the cameras take them, or calibrate again with this zoom and focus",
                rest=rest,
            )
        )
    return found


def _moved(drift: Drift, rest: Doubles, error: float) -> Explanation:
    """A drift, or one so large that the rig must be another's."""
    if drift.turn_deg > FAR_DEG or _median(rest) > UNEXPLAINED_PX:
        if error <= UNEXPLAINED_PX:
            # Rows that fit so well are no other cameras': yaw, which moves rows little, made up for a lens's rest.
            return Explanation(fault=Fault.NONE, rest=rest)
        return Explanation(
            fault=Fault.OTHER_RIG,
            amount=drift.turn_deg,
            says="the rig belongs to other cameras, or one was turned or refocused by much since the calibration",
            mend="give these cameras' own rig, or calibrate again",
            rest=rest,
        )
    return Explanation(
        fault=Fault.MOVED,
        amount=drift.turn_deg,
        says=f"a camera moved since the calibration, by about {drift.turn_deg:.1f} degrees",
        mend="correct it with `stereo-gpu check --refine`, or calibrate again",
        rest=rest,
    )


def _behind(points_left: Doubles, points_right: Doubles, rig: Rig, rows: Rows, rest: Doubles) -> Explanation:
    """Tell swapped pictures from another's rig, when nearly all points would lie behind the cameras."""
    exchanged = find_rows(rays(points_right, rig.left), rays(points_left, rig.right), rig.R, rig.T, focal_length(rig))
    differ = _median(exchanged.vertical)
    if differ <= max(EXPLAINED * _median(rows.vertical), UNEXPLAINED_PX):
        return Explanation(
            fault=Fault.SWAPPED,
            says=f"the pictures look swapped: {share_behind(rows):.0%} of {len(points_left)} matched"
            f" points would lie behind the cameras; exchanged, rows differ by {differ:.2f} px",
            mend="give the left camera's picture first",
            rest=exchanged.vertical,
        )
    return Explanation(
        fault=Fault.OTHER_RIG,
        says="the rig belongs to other cameras, or both pictures are mirrored: nearly all points would lie behind the"
        f" cameras, and exchanged, rows differ by {differ:.2f} px",
        mend="give these cameras' own rig, and pictures as the cameras take them",
        rest=rest,
    )


def _undone(points: Doubles, camera: Camera, *, down: float = 0.0, turned: float = 0.0, larger: float = 0.0) -> Doubles:
    """Points where they were before the picture was shifted (px), turned clockwise (degrees) or enlarged (share)."""
    middle = (np.array(camera.size) - 1) / 2
    angle = np.radians(turned)
    back = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved: Doubles = (points - middle - [0.0, down]) @ back / (1 + larger) + middle
    return moved


def _fit(errors: Callable[[float], Doubles], unit: float) -> tuple[float, Doubles]:
    """The number for which the errors are smallest, by robust least squares, and those errors; `unit` is its scale."""

    def residuals(number: Doubles) -> Doubles:
        found: Doubles = np.nan_to_num(errors(float(number[0]) * unit), nan=10.0) / 0.3
        return found

    number = unit * float(fit_softly(residuals, np.zeros(1), np.ones(1), largest=LARGEST).numbers[0])
    return number, errors(number)


def _median(errors: Doubles) -> float:
    """Median error; points that a changed picture or the other lens puts outside of its model count as far off."""
    return float(np.median(np.nan_to_num(np.abs(errors), nan=np.inf)))
