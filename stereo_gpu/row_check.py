"""A quick check of a rig, for the pairs after the first: whether the rows of what was matched correspond."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_gpu.epipolar.consensus import ENOUGH
from stereo_gpu.epipolar.error_map import map_errors
from stereo_gpu.epipolar.faults import Fault
from stereo_gpu.images import grey
from stereo_gpu.rig import Camera, Rig
from stereo_gpu.rig_check import RigCheck, Verdict
from stereo_gpu.types import Disparity, Doubles, Floats, RectifiedPair, View

CELL = 24  # px: one place is looked at in each such square of the picture
PLACES = 400  # of them, those where brightness changes most from row to row
HALF = 5  # px: half of the window that is compared, less the middle
REACH = 4  # rows up and down
TEXTURE = 4.0  # grey levels, rms change of brightness over two rows, below which a place says nothing of rows
ALIKE = 0.7  # correlation of a place and its partner, below which they are not the same thing
# Plainly good or unknown: a map hides a part of an error, since what does not lie on one row is not matched well.
GOOD_PX = 0.3  # median vertical error; the built-in scene has 0.08, and 0.4 where the rig is 0.6 off
LEAST_ALIKE = 0.75  # share of the places that must have a partner
LEAST_COVERED = 0.3  # share of the wanted pixels that must have a disparity


def check_rows(pair: RectifiedPair, disparity: Disparity, rig: Rig) -> RigCheck:
    """Say from a disparity map whether rows correspond: on which row the partners of places with texture really lie.

    A few milliseconds where `check_rig` takes some hundred, since the columns are known. It tells that rows are right,
    not what is wrong: then the verdict is "unknown", and `check_rig` must say.

    Args:
        pair: the rectified pair.
        disparity: the map of it.
        rig: of the raw pictures.

    Returns:
        The verdict, "good" or "unknown", with the same figures as of matched features.
    """
    side = disparity.reference
    reference, other = (pair.left, pair.right) if side is View.LEFT else (pair.right, pair.left)
    size = (reference.shape[1], reference.shape[0])
    at = _places(grey(reference), disparity)
    offset, alike = np.zeros(0), np.zeros(0)
    if len(at):
        shift = disparity.values[at[:, 1], at[:, 0]] * (-1 if side is View.LEFT else 1)
        offset, alike = _rows_off(grey(reference), grey(other), at, shift)
    good = alike >= ALIKE
    # Above 0 the partner lies lower; the error is the row in the left picture less that in the right one.
    vertical = (offset if side is View.RIGHT else -offset)[good]
    error = float(np.median(np.abs(vertical))) if len(vertical) else float("nan")
    known = good.sum() >= max(ENOUGH, LEAST_ALIKE * len(at)) and disparity.coverage >= LEAST_COVERED
    fine = bool(known and error <= GOOD_PX)
    column = at[good, 0] + (shift[good] if len(at) else 0)
    partner = np.column_stack([column, at[good, 1] + offset[good]]).astype(np.float64)
    left, right = (at[good], partner) if side is View.LEFT else (partner, at[good])
    raw_left = _raw(left, rig.left, pair.rotation_left, pair, pair.cx_left)
    raw_right = _raw(right, rig.right, pair.rotation_right, pair, pair.cx_right)
    return RigCheck(
        matches=len(at),
        vertical_px=error,
        vertical_95_px=float(np.percentile(np.abs(vertical), 95)) if len(vertical) else float("nan"),
        bias_px=float(np.median(vertical)) if len(vertical) else float("nan"),
        behind=0.0,
        verdict=Verdict.GOOD if fine else Verdict.UNKNOWN,
        says=_in_words(error, len(vertical), len(at), disparity.coverage, fine=fine),
        fault=Fault.NONE,
        amount=float("nan"),
        map=map_errors(raw_left, vertical, size),
        points_left=raw_left,
        points_right=raw_right,
        vertical=vertical,
        size=size,
    )


def _places(picture: NDArray[np.uint8], disparity: Disparity) -> NDArray[np.intp]:
    """(N, 2) columns and rows: of each square of the picture the place whose rows differ most."""
    margin = HALF + REACH + 1
    change = cv2.Sobel(picture, cv2.CV_32F, 0, 1, ksize=1)
    texture = cv2.blur(change * change, (2 * HALF + 1, 2 * HALF + 1))
    height, width = picture.shape
    texture[disparity.validity != 0] = 0
    texture[:margin] = texture[height - margin :] = 0
    rows, columns = height // CELL, width // CELL
    squares = texture[: rows * CELL, : columns * CELL].reshape(rows, CELL, columns, CELL).swapaxes(1, 2)
    flat = squares.reshape(rows * columns, CELL * CELL)
    if not flat.size:
        return np.zeros((0, 2), np.intp)
    best = flat.argmax(axis=1)
    strength = flat[np.arange(len(flat)), best]
    chosen = np.argsort(-strength)[:PLACES]
    chosen = np.sort(chosen[strength[chosen] > TEXTURE**2])
    row = chosen // columns * CELL + best[chosen] // CELL
    column = chosen % columns * CELL + best[chosen] % CELL
    inside = (column >= margin) & (column < width - margin)
    places: NDArray[np.intp] = np.column_stack([column, row])[inside]
    return places


def _rows_off(
    reference: NDArray[np.uint8], other: NDArray[np.uint8], at: NDArray[np.intp], shift: Floats
) -> tuple[Doubles, Doubles]:
    """(N,) by how many rows the best partner of each place lies lower, sub-pixel, and (N,) how much alike they are."""
    across, along = np.arange(-HALF, HALF + 1), np.arange(-HALF - REACH, HALF + REACH + 1)
    column, row = at[:, 0, None, None], at[:, 1, None, None]
    mine = reference[row + across[:, None], column + across].astype(np.float32)
    exact = (at[:, 0] + shift).astype(np.float32)[:, None, None] + across.astype(np.float32)
    x, y = np.broadcast_arrays(exact, (row + along[:, None]).astype(np.float32))
    count = len(at)
    partner = cv2.remap(
        other, x.reshape(count, -1), y.reshape(count, -1), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    theirs = partner.reshape(count, len(along), len(across)).astype(np.float32)
    windows = np.lib.stride_tricks.sliding_window_view(theirs, len(across), axis=1)  # (N, rows, columns, window)
    mine -= mine.mean(axis=(1, 2), keepdims=True)
    means = windows.mean(axis=(2, 3), keepdims=True)
    products = np.einsum("nrcw,nwc->nr", windows, mine)  # the mean of `mine` is 0, so that theirs need not be
    spread = np.sqrt(np.maximum((windows**2).mean(axis=(2, 3)) - means[..., 0, 0] ** 2, 1e-6) * mine[0].size)
    alike = products / (spread * np.maximum(np.linalg.norm(mine, axis=(1, 2)), 1e-6)[:, None])
    best = alike.argmax(axis=1)
    middle = np.clip(best, 1, 2 * REACH - 1)
    low, top, high = (alike[np.arange(count), middle + step] for step in (-1, 0, 1))
    bend = np.minimum(low - 2 * top + high, -1e-6)
    between = np.clip((low - high) / (2 * bend), -0.5, 0.5)
    # A partner at the end of the reach may lie beyond it: it is counted at the end, which is far over the limit.
    offset = np.where(best == middle, middle + between, best) - REACH
    return offset.astype(np.float64), alike.max(axis=1).astype(np.float64)


def _raw(
    points: Doubles | NDArray[np.intp], camera: Camera, rotation: Doubles, pair: RectifiedPair, cx: float
) -> Doubles:
    """Where the raw picture shows places of the rectified one, (N, 2) px each."""
    if not len(points):
        return np.zeros((0, 2))
    ahead = np.column_stack([(points - np.array([cx, pair.cy])) / pair.focal_px, np.ones(len(points))])
    turned = np.ascontiguousarray(ahead @ rotation)  # its inverse is its transpose
    seen: Doubles = cv2.projectPoints(turned, np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)[0]
    return seen.reshape(-1, 2)


def _in_words(error: float, alike: int, places: int, coverage: float, *, fine: bool) -> str:
    found = f"{alike} of {places} places of the map found their partner"
    if fine:
        return f"rows differ by {error:.2f} px (median; {found}): the rig is good"
    told = "" if np.isnan(error) else f" and rows differ by {error:.2f} px"
    return f"{found}{told}, where {coverage:.0%} of the pixels have a disparity; let check_rig say what is wrong"
