"""The markers of a ChArUco board: which dictionaries there are, where the markers stand, and how they are found."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_gpu.errors import InputError
from stereo_gpu.types import Bytes, Doubles, Floats, Ints

Bools = NDArray[np.bool_]

FAMILIES = {  # the dictionaries of one line begin with the same markers, the shortest first
    "4x4": ("4x4_50", "4x4_100", "4x4_250", "4x4_1000"),
    "5x5": ("5x5_50", "5x5_100", "5x5_250", "5x5_1000"),
    "6x6": ("6x6_50", "6x6_100", "6x6_250", "6x6_1000"),
    "7x7": ("7x7_50", "7x7_100", "7x7_250", "7x7_1000"),
    "aruco_original": ("aruco_original",),
    "apriltag_16h5": ("apriltag_16h5",),
    "apriltag_25h9": ("apriltag_25h9",),
    "apriltag_36h10": ("apriltag_36h10",),
    "apriltag_36h11": ("apriltag_36h11",),
}
SMALLEST_PERIMETER = 0.015  # of the picture's longer side; OpenCV's 0.03 misses boards of many squares
CLOSE = 0.35  # squares: how far a neighbour may be from where a marker by itself says it is


@dataclass(frozen=True, eq=False)
class Markers:
    """Markers that were found.

    Args:
        outlines: (n, 4, 2) float32 px, clockwise from the marker's own top left.
        ids: (n,) int32.
    """

    outlines: Floats
    ids: Ints

    def __len__(self) -> int:
        return len(self.ids)

    def only(self, which: Bools) -> Markers:
        """Some of them."""
        return Markers(self.outlines[which], self.ids[which])


def dictionary_name(text: str) -> str:
    """The name as we write it, from what people write: 5x5_250, DICT_5X5_250.

    Raises:
        InputError: there is no such dictionary.
    """
    name = text.strip().lower().removeprefix("dict_") if isinstance(text, str) else ""
    known = [member for members in FAMILIES.values() for member in members]
    if name not in known:
        raise InputError(f"dictionary {text!r:.60}: give one of {', '.join(known)}")
    return name


def dictionary_size(name: str) -> int:
    """How many markers a dictionary has."""
    return len(_dictionary(name).bytesList)


def marker_squares(columns: int, rows: int, legacy: bool = False) -> Ints:
    """(n, 2) column and row of the square of each marker, in the order of their ids, from the top left.

    Markers stand in the white squares. The top left square is black; OpenCV before 4.6 made it white where the
    number of rows is even (`legacy`).
    """
    y, x = np.divmod(np.arange(columns * rows), columns)
    white = (x + y) % 2 == (0 if legacy and rows % 2 == 0 else 1)
    return np.column_stack([x[white], y[white]]).astype(np.int32)


def find_markers(flat: Bytes, dictionary: str) -> Markers:
    """Every marker of a dictionary in a picture, (H, W), each id once at most.

    An id that is there twice says nothing of a place, and is left out.
    """
    parameters = cv2.aruco.DetectorParameters()
    parameters.minMarkerPerimeterRate = SMALLEST_PERIMETER
    outlines, ids, _ = cv2.aruco.ArucoDetector(_dictionary(dictionary), parameters).detectMarkers(flat)
    if ids is None or not len(ids):
        return Markers(np.empty((0, 4, 2), np.float32), np.empty(0, np.int32))
    named = np.asarray(ids, np.int32).reshape(-1)
    once = np.isin(
        named, [number for number, often in zip(*np.unique(named, return_counts=True), strict=True) if often == 1]
    )
    return Markers(np.asarray(outlines, np.float32).reshape(-1, 4, 2)[once], named[once])


def steps_between(markers: Markers, ratio: float) -> Doubles:
    """(n, n, 2) from each marker to each other one, columns and rows, as its own outline measures the board.

    Good for close neighbours, whatever the lens does farther off.

    Args:
        markers: what was found.
        ratio: side of a marker over side of a square.
    """
    count = len(markers)
    centres = markers.outlines.mean(axis=1).reshape(1, -1, 2).astype(np.float32)
    half = ratio / 2
    home = np.array([[-half, -half], [half, -half], [half, half], [-half, half]], np.float32)
    steps = np.empty((count, count, 2))
    for number, outline in enumerate(markers.outlines):
        steps[number] = cv2.perspectiveTransform(centres, cv2.getPerspectiveTransform(outline, home))[0]
    return steps


def agreeing(markers: Markers, steps: Doubles, squares: Ints) -> Bools:
    """(n,): which markers have a diagonal neighbour where the layout has it.

    Args:
        markers: what was found.
        steps: of `steps_between`.
        squares: of `marker_squares`; ids beyond its end never agree.
    """
    close = np.abs(steps - _layout(markers, squares)).max(axis=-1) < CLOSE
    fits = diagonal_neighbours(markers, squares) & close
    return np.asarray(fits.any(axis=1) | fits.any(axis=0))


def diagonal_neighbours(markers: Markers, squares: Ints) -> Bools:
    """(n, n): which markers touch at a corner of their squares in the layout.

    Those in the same row are as far apart in every layout of the same width: only diagonals tell.
    """
    known = markers.ids < len(squares)
    return np.asarray((np.abs(_layout(markers, squares)) == 1).all(axis=-1) & known[:, None] & known)


def _layout(markers: Markers, squares: Ints) -> Ints:
    places = squares[np.minimum(markers.ids, len(squares) - 1)]
    return np.asarray(places[None] - places[:, None])


def interpolate(
    flat: Bytes, markers: Markers, columns: int, rows: int, ratio: float, dictionary: str, legacy: bool
) -> tuple[Floats, Ints]:
    """The inner corners between markers: (n, 2) px and (n,) ids, row by row from the top left.

    Each lies between two or more markers, whose own outlines place it (`cv2.aruco.CharucoDetector`).
    """
    board = _opencv_board(columns, rows, ratio, dictionary, legacy)
    corners, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(
        flat, markerCorners=[outline[None] for outline in markers.outlines], markerIds=markers.ids.reshape(-1, 1)
    )
    if ids is None or not len(ids):
        return np.empty((0, 2), np.float32), np.empty(0, np.int32)
    return np.asarray(corners, np.float32).reshape(-1, 2), np.asarray(ids, np.int32).reshape(-1)


def draw_marker(dictionary: str, number: int) -> Bytes:
    """A marker's cells with its black border, one pixel a cell, 0 or 255."""
    known = _dictionary(dictionary)
    side = known.markerSize + 2
    drawn: Bytes = cv2.aruco.generateImageMarker(known, number, side)
    return drawn


def _opencv_board(columns: int, rows: int, ratio: float, dictionary: str, legacy: bool) -> cv2.aruco.CharucoBoard:
    """OpenCV's own, without its line on stderr about markers close to the edge of their squares."""
    before = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        board = cv2.aruco.CharucoBoard((columns, rows), 1.0, ratio, _dictionary(dictionary))
    finally:
        cv2.utils.logging.setLogLevel(before)
    board.setLegacyPattern(legacy)
    return board


def _dictionary(name: str) -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name.upper()}"))
