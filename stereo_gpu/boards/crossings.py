"""A quick look for crossings of black and white squares, before a picture is searched for a checkerboard."""

from __future__ import annotations

import cv2
import numpy as np

from stereo_gpu.types import Bytes, Doubles, Floats

SIDES = (1600, 800, 400)  # px: copies to look at, since blur and size of the squares are not known
SMOOTHING = 1.5  # px
RING = 4.0  # px: radius on which black and white must take turns; squares of 6 px still show it
SAMPLES = 16  # on the ring
WEAKEST = 1.0  # grey values between black and white sectors, after smoothing
MOST = 4000  # crossings looked at, the strongest: far more than any board has
NEIGHBOURS = 10
SAME_STEP = 0.25  # of the distance to a neighbour: by how much the opposite one may miss its place
LEAST_SLANT = 0.3  # sine of the angle between a board's columns and rows, as seen
TURNED = np.deg2rad(25)  # by how much a neighbour's sectors may miss a quarter turn


def largest_grid(flat: Bytes, enough: int) -> int:
    """How many corners hang together as the inner corners of a checkerboard do, in the likeliest of a few copies.

    On a checkerboard the four nearest corners lie in pairs on opposite sides, and their black sectors are turned by
    90 degrees against those in the middle. A corner with two such pairs is linked to them; the largest group counts.

    Args:
        flat: (H, W).
        enough: stop at a copy that shows as many.
    """
    longest, best = max(flat.shape), 0
    sides = [min(longest, SIDES[0]), *(side for side in SIDES[1:] if side < longest), min(2 * longest, 2 * SIDES[0])]
    for side in sides:
        best = max(best, grid_at_size(_scaled(flat, side / longest)))
        if best >= enough:
            break
    return best


def grid_at_size(flat: Bytes) -> int:
    """The same of the picture as it is."""
    return _group(*_crossings(flat))


def _scaled(flat: Bytes, scale: float) -> Bytes:
    if scale == 1:
        return flat
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    scaled: Bytes = cv2.resize(flat, None, fx=scale, fy=scale, interpolation=how)
    return scaled


def _crossings(flat: Bytes) -> tuple[Doubles, Doubles]:
    """Where saddles with two black and two white sectors are, (n, 2) px, and the direction of these sectors."""
    smooth = cv2.GaussianBlur(flat.astype(np.float32), (0, 0), SMOOTHING)
    across, along, down = (cv2.Sobel(smooth, cv2.CV_32F, *orders) for orders in ((1, 1), (2, 0), (0, 2)))
    saddle = across * across - along * down  # minus the determinant of the Hessian
    peak = (saddle >= cv2.dilate(saddle, np.ones((5, 5), np.uint8))) & (saddle > 1.0)
    margin = int(np.ceil(RING)) + 1
    peak[:margin] = peak[-margin:] = False
    peak[:, :margin] = peak[:, -margin:] = False
    y, x = np.nonzero(peak)
    strongest = np.argsort(-saddle[y, x], kind="stable")[:MOST]
    places = np.column_stack([x[strongest], y[strongest]]).astype(np.float64)
    if not len(places):
        return places, np.empty(0)
    angles = np.arange(SAMPLES) * (2 * np.pi / SAMPLES)
    ring = places[:, None].astype(np.float32) + np.float32(RING) * np.stack([np.cos(angles), np.sin(angles)], -1)
    values: Floats = cv2.remap(smooth, ring.astype(np.float32), None, cv2.INTER_LINEAR).reshape(len(places), SAMPLES)
    # Two periods around the ring: the second harmonic carries a crossing, the first an edge, the fourth a grid's bar.
    waves = np.fft.rfft(values, axis=1) / SAMPLES
    power = np.abs(waves) ** 2
    rest = power[:, 1:].sum(axis=1) - power[:, 2]
    good = (power[:, 2] > 2 * rest) & (2 * np.abs(waves[:, 2]) > WEAKEST)
    return places[good], (-np.angle(waves[good, 2]) / 2) % np.pi


def _group(places: Doubles, directions: Doubles) -> int:
    """How many crossings hang together around those that have such pairs along two lines."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    count = len(places)
    if count < 3:
        return 0
    near = cKDTree(places).query(places, min(NEIGHBOURS + 1, count))[1][:, 1:]
    steps = places[near] - places[:, None]
    turned = np.abs((directions[near] - directions[:, None]) % np.pi - np.pi / 2) < TURNED
    # (n, k, k): how far neighbour j is from the place opposite to neighbour i
    missed = np.linalg.norm(steps[:, :, None] + steps[:, None], axis=-1)
    linked = (missed < SAME_STEP * np.linalg.norm(steps, axis=-1)[:, :, None]) & turned[:, :, None] & turned[:, None]
    # Along two lines: chance brings about one pair often, two that cross seldom.
    lines = np.arctan2(steps[..., 1], steps[..., 0])
    crossing = np.abs(np.sin(lines[:, :, None] - lines[:, None])) > LEAST_SLANT
    paired = linked.any(axis=2)
    middle = (crossing & paired[:, :, None] & paired[:, None]).any(axis=(1, 2))
    one, which = np.nonzero(paired & middle[:, None])
    graph = coo_array((np.ones(len(one), np.int8), (one, near[one, which])), shape=(count, count))
    labels = connected_components(graph, directed=False)[1]
    return int(np.bincount(labels).max())
