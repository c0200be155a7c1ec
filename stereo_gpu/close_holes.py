"""Close the small holes of a disparity map along their surface, and leave the large ones open."""

from __future__ import annotations

import dataclasses
import math

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_gpu.errors import InputError
from stereo_gpu.meshing.membrane import Places, relax
from stereo_gpu.types import Disparity, Floats, Validity, View

# px: how far a surface goes on beyond its last measured pixel, where nothing bounds the hole on the other side.
REACH = 11.0
# What the matcher filled in row by row differs from row to row: over such jumps of holes, in jumps of a surface, the
# membrane still pulls.
SLACK = 2.0
RIM = 4  # px of the surface next to a hole, whose slope tells whether the other end is on it
STEEPEST = 1.5  # px a pixel, of a surface: what is steeper is a jump
PASSES = 8  # of the membrane: it evens out rows, and does not flatten what the matcher knew better
TOOTH = 5  # px: what is narrower goes, be it ever so short
CORNER = 0.3  # of the square of a disc's radius: what the disc leaves of a right-angled corner is 1 - pi / 4

_Mask = NDArray[np.bool_]


def close_holes(disparity: Disparity, *, largest: int | None = 400, max_jump_px: float = 3.0) -> Disparity:
    """Close what no camera pair measured where it is small, and take the value of the rest.

    A hole is a connected part of wanted pixels without a measured disparity; what the matcher filled in is part of
    it. Holes of up to `largest` pixels are closed, and of larger ones those parts that are narrow: that no disc of so
    many pixels fits into. A large hole is mostly what one camera alone sees, and what stands in it is invented.

    A closed pixel starts with the value that the matcher filled in, or with that between the measured pixels at the
    hole's ends in its row and column: on the line between them if they are on one surface, which jumps by
    `max_jump_px` at most, else with the one behind, whose surface goes on behind the nearer one. A weak membrane
    then evens it out (Blake and Zisserman, "Visual Reconstruction", 1987): each pixel moves to the mean of those
    neighbours that are on its surface, and no pull crosses a jump.

    After smooth paths, what both cameras see with the value that the matcher filled in counts as measured: that value
    comes from planes through all that is sure around it, and flat parts without texture are mostly such.

    At the picture's and the mask's edge a surface goes on for 11 px at most: what lies farther out has a rim on one
    side alone and stays open, also with None.

    Args:
        disparity: the map; `match` makes it.
        largest: how many pixels a hole that is closed may have; 0 closes none, None all.
        max_jump_px: disparity difference over which two pixels are not on one surface, px.

    Returns:
        The map with the values that a mesh is to be made of. A closed pixel has FILLED beside its own reason, and
        confidence 0; an open one has NaN, its reason, and not FILLED.

    Raises:
        InputError: `largest` is below 0, or `max_jump_px` not above 0.
    """
    if largest is not None and largest < 0:
        raise InputError(f"largest is {largest}: pass a number of pixels, or None for all holes")
    if not max_jump_px > 0:
        raise InputError(f"max_jump_px is {max_jump_px}: pass a number above 0")
    values, validity = disparity.values, disparity.validity
    wanted = (validity & np.uint8(Validity.MASKED)) == 0
    measured = wanted & ((validity & np.uint8(Validity.FILLED)) == 0) & np.isfinite(values)
    hole = wanted & ~measured
    small = _find_small(hole, measured, largest)
    if largest != 0 and disparity.options.get("smooth_paths"):
        small |= hole & _seen_by_both(disparity, max_jump_px)
    closed = np.where(measured | small, values, np.float32(np.nan))
    unknown = np.flatnonzero(small & np.isnan(closed))
    if len(unknown):
        known = np.where(measured, values, np.float32(np.nan))
        closed.ravel()[unknown] = _between_ends(known, hole, unknown, max_jump_px)
    moving = np.flatnonzero(small & np.isfinite(closed))
    relax(closed, moving, max_jump_px=max_jump_px, slack=SLACK, passes=PASSES)
    has_value = np.isfinite(closed)
    reason = validity & ~np.uint8(Validity.FILLED)
    return dataclasses.replace(
        disparity,
        values=closed,
        validity=np.where(hole & has_value, reason | np.uint8(Validity.FILLED), reason),
        confidence=np.where(measured, disparity.confidence, np.float32(0)),
    )


def _find_small(hole: _Mask, measured: _Mask, largest: int | None) -> _Mask:
    """(H, W): pixels of holes that are to be closed."""
    if largest == 0 or not measured.any():
        return np.zeros_like(hole)
    away = cv2.distanceTransform((~measured).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)
    # Half a pixel more, which is how far the next pixel's middle lies beyond the disc.
    small = hole if largest is None else _narrow(hole, away, math.sqrt(largest / math.pi) + 0.5)
    far = small & (away > REACH)
    return small & ~(far & ~_bounded(measured)) if far.any() else small


def _seen_by_both(disparity: Disparity, max_jump_px: float) -> _Mask:
    """(H, W): pixels whose value puts them into the other camera's picture, with nothing before them."""
    values = disparity.values
    height, width = values.shape
    given = np.flatnonzero(np.isfinite(values))
    nearness = values.ravel()[given]
    rows, columns = np.divmod(given, width)
    to_right = disparity.reference is View.RIGHT
    shift = np.rint(nearness).astype(np.intp)
    partner = columns + shift if to_right else columns - shift
    inside = (partner >= 0) & (partner < width)
    given, nearness, partner = given[inside], nearness[inside], (rows * width + partner)[inside]
    front = np.full(height * width, -np.inf, np.float32)
    # Of the pixels with one partner the nearest is the first in the row, or, from the left, the last: it is to be
    # written last.
    order = slice(None, None, -1) if to_right else slice(None)
    front[partner[order]] = nearness[order]
    seen = np.zeros(height * width, np.uint8)
    seen[given] = front[partner] <= nearness + np.float32(max_jump_px)
    # Single pixels are seen through gaps of what is before them, where the map is wrong.
    whole = cv2.morphologyEx(seen.reshape(height, width), cv2.MORPH_OPEN, np.ones((5, 5), np.uint8))
    return np.asarray(whole != 0)


def _narrow(hole: _Mask, away: Floats, radius: float) -> _Mask:
    """(H, W): where a disc cannot get that rolls through the holes; `away` is how far it is to what was measured."""
    core = hole & (away > radius)
    if not core.any():
        return hole
    to_core = cv2.distanceTransform((~core).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)
    narrow: _Mask = hole & (to_core > radius)
    # A wide hole keeps its corners.
    _, part = cv2.connectedComponents(narrow.view(np.uint8), ltype=cv2.CV_32S)
    beside = cv2.dilate((hole & ~narrow).view(np.uint8), np.ones((3, 3), np.uint8))
    corner = np.bincount(part.ravel()) < CORNER * radius * radius + 1
    of_wide = np.zeros_like(corner)
    of_wide[part[(beside != 0) & narrow]] = True
    # But its outline has no teeth.
    side = max(1, min(TOOTH, math.floor(radius)))
    blunt = cv2.morphologyEx(hole.view(np.uint8), cv2.MORPH_OPEN, np.ones((side, side), np.uint8))
    return np.asarray(hole & (narrow & ~(corner & of_wide)[part] | (blunt == 0)))


def _bounded(measured: _Mask) -> _Mask:
    """(H, W): pixels with measured ones on both sides, in their row or in their column."""
    bounded = np.zeros_like(measured)
    for axis in (0, 1):
        before = np.logical_or.accumulate(measured, axis)
        after = np.flip(np.logical_or.accumulate(np.flip(measured, axis), axis), axis)
        bounded |= before & after
    return bounded


def _between_ends(known: Floats, hole: _Mask, places: Places, max_jump_px: float) -> Floats:
    """(N,): what the ends of its hole say of each pixel, in its row and in its column; NaN if nothing.

    Args:
        known: (H, W) disparities, NaN where none was measured.
        hole: (H, W), where one is wanted.
        places: (N,) flat indices of pixels of holes.
        max_jump_px: as `close_holes` takes it.
    """
    rows, columns = np.divmod(places, known.shape[1])
    level, nearer = _along_rows(known, hole, rows, columns, max_jump_px)
    upright, closer = _along_rows(known.T, hole.T, columns, rows, max_jump_px)
    # NaN compares as false.
    both = (level * nearer + upright * closer) / (nearer + closer)
    agreed = np.abs(level - upright) <= max_jump_px
    # Where they differ, that of the nearer end, since what lies between is less.
    nearest = np.where((nearer >= closer) & ~np.isnan(level) | np.isnan(upright), level, upright)
    return np.asarray(np.where(agreed, both, nearest), np.float32)


def _along_rows(known: Floats, hole: _Mask, rows: Places, columns: Places, max_jump_px: float) -> tuple[Floats, Floats]:
    """(N,), (N,): the value between the hole's ends in the row, NaN without two; its weight, 1 / px."""
    used, row = np.unique(rows, return_inverse=True)
    known, hole = known[used], hole[used]
    width = hole.shape[1]
    number = np.arange(width)
    before = np.maximum.accumulate(np.where(hole, -1, number), axis=1)[row, columns]
    after = np.minimum.accumulate(np.where(hole, width, number)[:, ::-1], axis=1)[:, ::-1][row, columns]
    inside = (before >= 0) & (after < width)
    left, right = known[row, before], known[row, np.minimum(after, width - 1)]
    gap = (after - before).astype(np.float32)
    rise = right - left
    lean = (_slope(known, row, before, -RIM) + _slope(known, row, after, RIM)) / 2
    value = np.where(
        np.abs(rise - lean * gap) <= max_jump_px, left + rise * ((columns - before) / gap), np.minimum(left, right)
    )
    weight = 1 / np.minimum(columns - before, after - columns)
    return np.where(inside, value, np.float32(np.nan)).astype(np.float32), weight.astype(np.float32)


def _slope(known: Floats, rows: Places, columns: Places, away: int) -> Floats:
    """(N,): change of disparity a pixel between these pixels and those `away` along the row; 0 if it is not known."""
    width = known.shape[1]
    inside = (columns >= 0) & (columns < width) & (columns + away >= 0) & (columns + away < width)
    rim, beyond = np.where(inside, columns, 0), np.where(inside, columns + away, 0)
    slope = (known[rows, beyond] - known[rows, rim]) / np.float32(away)
    return np.where(np.abs(slope) <= STEEPEST, slope, np.float32(0))  # false for NaN
