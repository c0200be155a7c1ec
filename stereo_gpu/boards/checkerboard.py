"""How a checkerboard is found in a picture."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from stereo_gpu.boards.crossings import grid_at_size, largest_grid
from stereo_gpu.images import grey
from stereo_gpu.types import Bytes, Floats, Picture

FEWEST_SQUARES = 4  # a side: OpenCV's finders want three inner corners
SMALLEST_SQUARE = 4  # px: OpenCV fails outright on a picture of a few pixels
WORKING_SIDE = 1600  # px: on larger pictures the board is found on a smaller copy, then refined on the whole one
REFINEMENT_WINDOW = 0.25  # of the shortest distance between corners; at 0.4 it reaches into the next square
LARGEST_WINDOW = 15  # px, half a side
LEAST_SHARE = 0.7  # of the corners that a first look must show, but for the four ends; real boards showed 0.95 or more
SECTOR_FLAGS = (  # each finds boards that the other misses
    cv2.CALIB_CB_ACCURACY,
    cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE,
)
CLASSIC_FLAGS = (
    cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE,
    cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_FILTER_QUADS,
)
# The sector-based finder draws at random: what it finds must not depend on what was searched before. This is the seed
# with which OpenCV itself starts.
OPENCV_SEED = -1


def find_checkerboard(picture: Picture, size: tuple[int, int]) -> Floats | None:
    """Find all inner corners of a checkerboard: (N, 2) float32 px, row by row, or None.

    A quick look refuses pictures that show nothing like it. Then OpenCV's sector-based finder (Duda and Frese 2018)
    and the classic one are tried on the picture, on a copy with its contrast evened out, and on another size of it;
    the corners are refined on the picture itself. Which of its ends is the first corner is left open; going along a
    row and then down the rows always turns clockwise.

    Args:
        picture: any picture.
        size: columns and rows of inner corners.
    """
    flat = grey(picture)
    needed = int(LEAST_SHARE * (size[0] * size[1] - 4))
    if too_thin(flat, min(size) + 1) or largest_grid(flat, needed) < needed:
        return None
    for number, scaled in enumerate(_copies(flat, needed)):
        # What every finder missed on the picture itself is seldom there: a quicker search of the other copies.
        quick = (SECTOR_FLAGS[:1], CLASSIC_FLAGS[:1])
        corners = _search(scaled, size, *(quick if number else (SECTOR_FLAGS, CLASSIC_FLAGS)))
        if corners is not None:
            scale = flat.shape[1] / scaled.shape[1], flat.shape[0] / scaled.shape[0]
            return _refine(flat, _clockwise((corners + 0.5) * scale - 0.5, size), size)
    return None


def survey_checkerboard(picture: Picture) -> tuple[int, int] | None:
    """How many squares the checkerboard in a picture has, (longer side, shorter side); a hint, None without one.

    A board of 4 x 4 squares is not told from clutter.
    """
    flat, flags = grey(picture), cv2.CALIB_CB_LARGER | cv2.CALIB_CB_NORMALIZE_IMAGE
    least = (FEWEST_SQUARES - 1) ** 2 - 4
    if too_thin(flat, FEWEST_SQUARES) or largest_grid(flat, least) < least:
        return None
    # Starting from 3 x 3 corners, the finder grows the board as far as it goes and says how far that was.
    cv2.setRNGSeed(OPENCV_SEED)
    found, _, meta = cv2.findChessboardCornersSBWithMeta(shrunk(flat), (3, 3), flags)
    if not found or meta is None or max(meta.shape[:2]) < FEWEST_SQUARES:
        return None  # 3 x 3 corners by themselves are found by chance, too
    return max(meta.shape[:2]) + 1, min(meta.shape[:2]) + 1


def place_corners(flat: Bytes, corners: Floats, reach: float) -> Floats:
    """Where the edges meet, (n, 2) px, to a few hundredths of a pixel.

    The sector-based finder's own positions are kept as the start only: on real boards this step took the
    reprojection error from 0.26 to 0.20 px.

    Args:
        flat: (H, W).
        corners: (n, 2) px, where to begin.
        reach: px around them in which there is nothing but their own edges.
    """
    half = int(np.clip(round(reach), 2, LARGEST_WINDOW))
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-4)
    placed = cv2.cornerSubPix(flat, corners.reshape(-1, 1, 2).astype(np.float32), (half, half), (-1, -1), stop)
    result: Floats = placed.reshape(-1, 2)
    return result


def shrunk(flat: Bytes, side: int = WORKING_SIDE) -> Bytes:
    """The picture, or a copy whose longer side has so many px where its own has more."""
    scale = side / max(flat.shape)
    small: Bytes = cv2.resize(flat, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else flat
    return small


def too_thin(flat: Bytes, squares: int) -> bool:
    """Whether so many squares cannot be seen across the copy of the picture that is searched."""
    return bool(min(flat.shape) * min(1.0, WORKING_SIDE / max(flat.shape)) < SMALLEST_SQUARE * squares)


def _copies(flat: Bytes, needed: int) -> Iterator[Bytes]:
    """Where to look, the likeliest first; a larger copy only where squares are small and it shows enough crossings."""
    small = shrunk(flat)
    yield small
    yield cv2.createCLAHE(clipLimit=3.0, tileGridSize=(4, 4)).apply(small)
    other = None
    if small is not flat:
        other = shrunk(flat, 2 * WORKING_SIDE)
    elif 2 * max(flat.shape) <= WORKING_SIDE:
        other = cv2.resize(flat, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    if other is None or grid_at_size(shrunk(small, max(small.shape) // 2)) >= needed:
        return
    if grid_at_size(other) >= needed:
        yield other


def _search(
    flat: Bytes, size: tuple[int, int], sector_flags: tuple[int, ...], classic_flags: tuple[int, ...]
) -> Floats | None:
    for flags in sector_flags:
        cv2.setRNGSeed(OPENCV_SEED)
        found, corners = cv2.findChessboardCornersSB(flat, size, flags=flags)
        if found:
            return np.asarray(corners, np.float32).reshape(-1, 2)
    for flags in classic_flags:
        found, corners = cv2.findChessboardCorners(flat, size, flags=flags)
        if found:
            return np.asarray(corners, np.float32).reshape(-1, 2)
    return None


def _clockwise(corners: Floats, size: tuple[int, int]) -> Floats:
    columns, rows = size
    grid = corners.astype(np.float32).reshape(rows, columns, 2)
    along, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if along[0] * down[1] - along[1] * down[0] < 0:
        grid = grid[:, ::-1]
    return np.ascontiguousarray(grid.reshape(-1, 2))


def _refine(flat: Bytes, corners: Floats, size: tuple[int, int]) -> Floats:
    columns, rows = size
    grid = corners.reshape(rows, columns, 2)
    shortest = min(float(np.linalg.norm(np.diff(grid, axis=axis), axis=-1).min()) for axis in (0, 1))
    return place_corners(flat, corners, REFINEMENT_WINDOW * shortest)
