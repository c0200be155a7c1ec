"""Which pixels count: all, non-occluded, and visible near jumps of disparity, from mask files or from the truth."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_gpu.errors import InputError
from stereo_gpu.evaluation.scores import Mask, size
from stereo_gpu.evaluation.truth import read_grey
from stereo_gpu.types import Floats, View

COUNTS = 255  # the grey level of pixels that count; Middlebury's masks hold 128 too, for other reasons not to count
JUMP = 2.0  # px between neighbours from which on a jump lies there
REACH = 9  # px, side of the square around a jump, or around what is occluded, that is near it
SAME = 1.0  # px by which two disparities may differ and still be of one surface


def read_mask(path: str | os.PathLike[str]) -> Mask:
    """Read a mask picture, (H, W) bool, true where it is white: 255 of 8 bits.

    Raises:
        InputError: no such picture, coloured, of 16 bits, or nothing in it is white.
    """
    path = Path(path)
    picture = read_grey(path)
    if picture.dtype != np.uint8:
        raise InputError(f"{path} has 16 bits: save the mask with 8, {COUNTS} where a pixel counts")
    mask: Mask = picture == COUNTS
    if not mask.any():
        raise InputError(f"{path} is {int(picture.max())} at most: a mask is {COUNTS} where a pixel counts")
    return mask


def nonoccluded(truth: Floats, reference: View = View.LEFT) -> Mask:
    """The pixels that the other camera sees too, (H, W) bool, from the truth of the reference view alone.

    A pixel counts unless something nearer by more than 1 px lands on its column of the other view, or its column lies
    outside of the picture. A dense truth is needed: surfaces whose truth is unknown hide nothing.

    Args:
        truth: (H, W) px, NaN where it is unknown.
        reference: the view on which it is laid out.
    """
    if reference is View.RIGHT:
        return nonoccluded(truth[:, ::-1])[:, ::-1]
    rows, columns = _grid(truth)
    lands = np.where(np.isfinite(truth), columns - truth, np.inf)
    front = np.full(truth.shape, -np.inf, np.float32)  # the nearest that lands on each pixel of the other view
    _land(front, rows, lands, truth)
    # A surface that the other camera sees stretched leaves gaps between its pixels, through which nothing shows.
    joined = np.abs(np.diff(truth, axis=1)) <= SAME
    between = np.where(joined, (truth[:, 1:] + truth[:, :-1]) / 2, np.nan)
    _land(front, rows[:, 1:], columns[:, 1:] - 0.5 - between, between)
    column = np.rint(lands)
    inside = (column >= 0) & (column < truth.shape[1])
    nearest = front[rows, np.where(inside, column, 0).astype(np.int64)]
    # A steep surface that the other camera sees pressed together has many pixels on one column, in their order: what
    # hides a pixel stands to its right and lands to its left.
    crossed = np.full(truth.shape, False)
    crossed[:, :-1] = np.minimum.accumulate(lands[:, :0:-1], axis=1)[:, ::-1] <= lands[:, :-1]
    return np.asarray(inside & ~(crossed & (nearest > truth + SAME)))


def consistent(truth: Floats, other: Floats, reference: View = View.LEFT) -> Mask:
    """The pixels that the other camera sees too, (H, W) bool, from the truths of both views.

    A pixel counts if the other view's truth agrees within 1 px at one of the two columns beside the point where it
    lands. Where the other truth is unknown it does not count.

    Args:
        truth: (H, W) px, of the reference view, NaN where it is unknown.
        other: (H, W) px, of the other view.
        reference: the view on which `truth` is laid out.

    Raises:
        InputError: the sizes differ.
    """
    if truth.shape != other.shape:
        raise InputError(f"one truth is {size(truth)}, the other view's {size(other)}: give two of one size")
    if reference is View.RIGHT:
        return consistent(truth[:, ::-1], other[:, ::-1])[:, ::-1]
    rows, columns = _grid(truth)
    agrees = np.zeros(truth.shape, bool)
    for beside in (np.floor(columns - truth), np.ceil(columns - truth)):
        inside = np.isfinite(beside) & (beside >= 0) & (beside < truth.shape[1])
        met = other[rows, np.where(inside, beside, 0).astype(np.int64)]
        agrees |= inside & (np.abs(met - truth) <= SAME)
    return agrees


def near_jumps(truth: Floats, visible: Mask) -> Mask:
    """The visible pixels near jumps of disparity, (H, W) bool: what Middlebury calls disc.

    Near is within a square of 9 x 9 px around a pixel that differs from one of its four neighbours by 2 px or more, or
    that is occluded. With Middlebury's own masks of visible pixels this gives its disc of Tsukuba but for 11 pixels.
    An unknown truth is no jump here; in Teddy, where Middlebury counts it as one, 8 % of its disc are missing.

    Args:
        truth: (H, W) px, NaN where it is unknown.
        visible: (H, W) bool, the non-occluded pixels.

    Raises:
        InputError: the sizes differ.

    Source: Scharstein and Szeliski, "A Taxonomy and Evaluation of Dense Two-Frame Stereo", section 5.1.
    """
    if truth.shape != visible.shape:
        raise InputError(f"the mask is {size(visible)}, the truth {size(truth)}: give two of one size")
    known = np.isfinite(truth)
    marked = known & ~visible
    across, down = np.abs(np.diff(truth, axis=1)) >= JUMP, np.abs(np.diff(truth, axis=0)) >= JUMP
    marked[:, 1:] |= across
    marked[:, :-1] |= across
    marked[1:] |= down
    marked[:-1] |= down
    near = cv2.dilate(marked.astype(np.uint8), np.ones((REACH, REACH), np.uint8)) != 0
    return np.asarray(near & visible & known)


def _grid(truth: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The row and the column of every pixel."""
    rows, columns = np.mgrid[: truth.shape[0], : truth.shape[1]]
    return rows, columns


def _land(front: Floats, rows: NDArray[Any], columns: NDArray[Any], disparity: Floats) -> None:
    """Keep the largest disparity that lands on each pixel of `front`."""
    column = np.rint(columns)
    inside = np.isfinite(column) & (column >= 0) & (column < front.shape[1])
    np.maximum.at(front, (rows[inside], column[inside].astype(np.int64)), disparity[inside])
