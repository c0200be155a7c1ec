"""Match pictures of any size in overlapping tiles, so that a tile bounds the memory and not the picture."""

from __future__ import annotations

import dataclasses
import itertools
import logging
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stereo_gpu.backends import Backend
from stereo_gpu.config import MatchOptions, Profile
from stereo_gpu.device_match import (
    check_match_memory,
    count_sure,
    download_disparity,
    drop_all,
    is_founded,
    match_bytes,
    match_on,
)
from stereo_gpu.flat_surfaces import CELL, LEVEL_REACH, SPACING
from stereo_gpu.prepare import Levels
from stereo_gpu.timing import Stopwatch
from stereo_gpu.types import Bytes, Disparity, Picture, Validity, View
from stereo_gpu.windows import surroundings

_log = logging.getLogger(__name__)

MEMORY_SHARE = 0.5  # of what is available; the rest is for other jobs, and for what the estimate does not see
SMALLEST_SIDE = 64  # px kept of a tile; a smaller one is nearly all margin
KEPT_BYTES = 9  # a pixel of the whole picture, on the host: value, validity and confidence
# How far a smooth path is felt, px. It has no end: tools/seams measures where it no longer changes a map. On textured
# surfaces that both cameras see that is less than 100 px, across flat ones 200; it is further in the columns that only
# one camera sees, where nothing but paths tells a disparity.
PATH_REACH = 256
CENSUS_REACH = 2  # as in the kernel
GRID = CELL * SPACING  # px; a tile starts where the whole picture has a plane, too


@dataclass(frozen=True, kw_only=True)
class Margin:
    """What a tile takes along around the part that is kept, px; rows above and below alike."""

    left: int
    right: int
    rows: int


@dataclass(frozen=True, kw_only=True)
class Tile:
    """A part of the pictures, as slices of rows and columns: what is matched, and what is kept of it."""

    taken: tuple[slice, slice]
    kept: tuple[slice, slice]

    @property
    def inner(self) -> tuple[slice, slice]:
        """What is kept, counted from where the taken part begins."""
        (rows, columns), (top, left) = self.kept, (side.start for side in self.taken)
        return slice(rows.start - top, rows.stop - top), slice(columns.start - left, columns.stop - left)


def match_in_tiles(
    backend: Backend,
    left: Picture,
    right: Picture,
    *,
    levels: tuple[Levels, Levels],
    masks: tuple[Bytes, Bytes],
    smallest: int,
    disparities: int,
    reference: View,
    profile: Profile,
    options: MatchOptions,
    watch: Stopwatch,
) -> Disparity:
    """Match two pictures: as a whole where they fit the device, else in overlapping tiles.

    The host holds the maps of the whole picture, the device one tile. Profiles "paper" and "fast" give the untiled
    map to the bit; smooth paths have no end, so that with "precise" a pixel in 10,000 of a large picture may differ.

    Args:
        backend: where to compute.
        left, right: rectified pictures of one size, on the host.
        levels: of the left and right picture's values; of the whole pictures.
        masks: of the reference view and of the other one, on the host.
        smallest, disparities: the range to search.
        reference: the view that the map is laid out on.
        profile: whose options these are; recorded.
        options: of the matching; `tile` bounds the side of what is kept of a tile.
        watch: collects seconds a step.

    Returns:
        The map; its options tell with "tiles" how many there were, columns and rows.

    Raises:
        MemoryLimitError: not even the smallest tile fits the device.
    """
    height, width = left.shape[:2]
    tiles, grid = choose_tiles(backend, width, height, smallest, disparities, reference, options)
    values, confidence = (np.empty((height, width), np.float32) for _ in range(2))
    validity = np.empty((height, width), np.uint8)
    sure = given = 0

    def match_tile(tile: Tile) -> None:
        # A function of its own, so that the device's memory is free again before the next tile takes some.
        nonlocal sure, given, levels
        cut_left, cut_right, ours, theirs = (
            backend.upload(np.ascontiguousarray(array[tile.taken])) for array in (left, right, *masks)
        )
        found = match_on(
            backend,
            cut_left,
            cut_right,
            levels=levels,
            masks=(ours, theirs),
            smallest=smallest,
            disparities=disparities,
            reference=reference,
            options=options,
            watch=watch,
        )
        # The same for all tiles, or seams would show where the noise decides.
        levels = (levels[0]._replace(noise=found.noise), levels[1]._replace(noise=found.noise))
        part = download_disparity(backend, found, smallest, disparities, reference, profile, options, watch)
        for whole, cut in ((values, part.values), (validity, part.validity), (confidence, part.confidence)):
            whole[tile.kept] = cut[tile.inner]
        if options.smooth_paths:
            counts = count_sure(part, tile.inner)
            sure, given = sure + counts[0], given + counts[1]

    for number, tile in enumerate(tiles, 1):
        if len(tiles) > 1:
            rows, columns = tile.kept
            _log.info(
                "tile %d of %d: %d x %d px at column %d, row %d",
                *(number, len(tiles)),
                *(columns.stop - columns.start, rows.stop - rows.start, columns.start, rows.start),
            )
        if masks[0][tile.kept].any():
            match_tile(tile)
        else:
            values[tile.kept], validity[tile.kept], confidence[tile.kept] = np.nan, Validity.MASKED, 0
    if options.smooth_paths and (any(level.flat for level in levels) or not is_founded(sure, given)):
        drop_all(values, validity)
        confidence[...] = 0
    return Disparity(
        values=values,
        validity=validity,
        confidence=confidence,
        reference=reference,
        smallest=smallest,
        disparities=disparities,
        backend=backend.name,
        device=backend.device,
        options={"profile": str(profile), **dataclasses.asdict(options), "tiles": list(grid)},
        seconds=dict(watch.seconds),
    )


def choose_tiles(
    backend: Backend,
    width: int,
    height: int,
    smallest: int,
    disparities: int,
    reference: View,
    options: MatchOptions,
) -> tuple[list[Tile], tuple[int, int]]:
    """Cut a picture into the tiles that cost the least work of those that fit the device's memory.

    Returns:
        The tiles, row by row, and how many there are in a row and in a column; one where the whole picture fits.

    Raises:
        MemoryLimitError: not even the smallest tile fits.
    """
    available, one = backend.available_bytes()
    if backend.kind == "cpu":
        available -= KEPT_BYTES * width * height

    def fits(taken_width: int, taken_height: int) -> bool:
        needed, largest = match_bytes(backend, taken_width, taken_height, disparities, options)
        return needed <= MEMORY_SHARE * available and largest <= one

    margin = find_margin(options, smallest, disparities, reference)
    planned = plan_tiles(width, height, margin, fits, options.tile)
    if planned is None:
        planned = plan_tiles(width, height, margin, lambda *_: True, min(SMALLEST_SIDE, options.tile or SMALLEST_SIDE))
        assert planned is not None  # as everything fits
        sides = [[side.stop - side.start for side in tile.taken] for tile in planned[0]]
        check_match_memory(backend, max(s[1] for s in sides), max(s[0] for s in sides), disparities, options)
    return planned


def plan_tiles(
    width: int, height: int, margin: Margin, fits: Callable[[int, int], bool], largest: int | None = None
) -> tuple[list[Tile], tuple[int, int]] | None:
    """Cut a picture into tiles whose kept parts cover it once, with the least that is matched in all.

    Args:
        width, height: of the picture, px.
        margin: what each tile takes along, as far as the picture goes.
        fits: whether a tile that takes so many columns and rows fits.
        largest: bound of the kept side, px; None for no other bound than `fits`.

    Returns:
        The tiles, row by row, and their number in a row and in a column; None where none fits.
    """
    across, down = (
        [_cut(length, parts, *around) for parts in _numbers(length, largest)]
        for length, around in ((width, (margin.left, margin.right)), (height, (margin.rows, margin.rows)))
    )
    best, least = None, 0
    for columns in across:
        # More rows make smaller tiles: find the first number of them that fits.
        low, high = 0, len(down)
        while low < high:
            middle = (low + high) // 2
            if fits(_widest(columns), _widest(down[middle])):
                high = middle
            else:
                low = middle + 1
        if low == len(down):
            continue
        work = _total(columns) * _total(down[low])
        if best is None or work < least:
            best, least = (columns, down[low]), work
    if best is None:
        return None
    columns, rows = best
    tiles = [Tile(taken=(r[0], c[0]), kept=(r[1], c[1])) for r in rows for c in columns]
    return tiles, (len(columns), len(rows))


def find_margin(options: MatchOptions, smallest: int, disparities: int, reference: View) -> Margin:
    """How far around a pixel its result may depend on the pictures.

    Every step looks at the result of the step before it, so that their reaches add up:

    - The prefilter and the pixel's own window, or the census and the smooth paths, which fade: see PATH_REACH.
    - Along the row, its partners in the other view, smallest to smallest + disparities - 1 px away; and, for the
      left-right check, all that compete for these partners, up to disparities - 1 px to either side.
    - Median; where several windows are tried, the support of each and the median of what is chosen.
    - After smooth paths the choice of a slope and the planes, of flat parts and of all.
    - Support, filling (along the row), and once more the median.

    Holes that smooth paths leave are filled from as far as it takes, which the margin does not hold: one that is wider
    is filled from the tile's side of it.
    """
    median = options.median // 2
    window = max((options.window, *options.windows)) // 2
    prefilter = math.ceil(3 * options.smooth_sigma)
    choice = max((surroundings(side)[0] for side in options.windows), default=0) + (median if options.windows else 0)
    paths = CENSUS_REACH + PATH_REACH if options.smooth_paths else 0
    planes = options.slope_window // 2 + LEVEL_REACH + options.plane_reach if options.smooth_paths else 0
    support = options.support_reach if options.support_share > 0 else 0
    fill = options.fill_reach + 1 if options.fill_reach else 0
    rows = prefilter + window + paths + median + choice + planes + support + (median if fill else 0)
    columns = rows + fill + 1  # a partner at a fraction of a pixel may round to one more
    ends = (smallest, smallest + disparities - 1)
    low, high = ends if reference is View.RIGHT else (-ends[1], -ends[0])
    return Margin(left=columns + max(disparities - 1, -low), right=columns + max(disparities - 1, high), rows=rows)


def _numbers(length: int, largest: int | None) -> range:
    """Into how many parts a side may be cut."""
    fewest = -(-length // largest) if largest else 1
    return range(fewest, max(fewest, length // SMALLEST_SIDE) + 1)


def _cut(length: int, parts: int, before: int, after: int) -> list[tuple[slice, slice]]:
    """Cut a side into parts as equal as can be: of each what is taken, with its margins, and what is kept."""
    ends = [length * i // parts for i in range(parts + 1)]
    kept = [slice(start, stop) for start, stop in itertools.pairwise(ends)]
    return [(slice(max(0, (k.start - before) // GRID * GRID), min(length, k.stop + after)), k) for k in kept]


def _widest(parts: list[tuple[slice, slice]]) -> int:
    return max(int(taken.stop - taken.start) for taken, _ in parts)


def _total(parts: list[tuple[slice, slice]]) -> int:
    return sum(int(taken.stop - taken.start) for taken, _ in parts)
