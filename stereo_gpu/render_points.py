"""Pictures of point clouds: every point a small square, the nearest one on top."""

from __future__ import annotations

import cv2
import numpy as np

from stereo_gpu.drawing.orbit import CLOUD_OUTLIERS, orbit
from stereo_gpu.errors import InputError, StageError
from stereo_gpu.render import BACKGROUND, Colour, check_size
from stereo_gpu.types import Bytes, Floats

_MOST = 1 << 24  # points: float32 counts no further
_FRAMED = 20_000  # points that are enough to frame the rest


def render_points(
    points: Floats,
    colours: Bytes,
    *,
    size: tuple[int, int] = (640, 480),
    yaw: float = 0.0,
    pitch: float = 0.0,
    background: Colour = BACKGROUND,
    supersample: int = 2,
) -> Bytes:
    """Draw a point cloud, (height, width, 3) uint8 RGB.

    The points are entered from the farthest to the nearest, each with its place in that order; the largest place in a
    square around a sample is the nearest point that covers it, which is a morphological dilation.

    Args:
        points: (N, 3) or (H, W, 3); points that are not finite are left out.
        colours: uint8 RGB of the same shape.
        size: (width, height) in px.
        yaw: degrees that the camera walks to its right around the points.
        pitch: degrees that it rises above them.
        background: colour where there is no point.
        supersample: samples a pixel in either direction.

    Raises:
        StageError: no point is finite and in front of the camera.
        InputError: a size below 1 or too large, or points and colours of unequal shape.
    """
    check_size(size, supersample)
    if points.shape != colours.shape:
        raise InputError(f"points {points.shape} and colours {colours.shape} differ: give one colour a point")
    places, paints = points.reshape(-1, 3), colours.reshape(-1, 3)
    # Column by column, here and below: numpy walks rows of three at a fraction of the pace.
    x, y, z = (np.ascontiguousarray(part) for part in places.T)
    good = np.flatnonzero(np.isfinite(x) & np.isfinite(y) & np.isfinite(z) & (z > 0))
    if not len(good):
        raise StageError(f"none of {len(places)} points is finite and in front of the camera")
    good = good[:: -(-len(good) // _MOST)]
    seen = np.stack([x[good], y[good], z[good]]).astype(np.float64).T
    inner = (size[0] * supersample, size[1] * supersample)
    camera = orbit(seen[:: max(1, len(seen) // _FRAMED)], inner, yaw=yaw, pitch=pitch, outliers=CLOUD_OUTLIERS)
    screen, depth = camera.see(seen)
    # Squares as large as the points lie apart, so that the cloud is dense but still seen to be points.
    apart = (0.8 * inner[0] * inner[1] / len(seen)) ** 0.5
    dot = int(np.clip(np.ceil(apart), supersample, 4 * supersample))
    # A border of one square, so that points just outside of the picture reach into it.
    wide, high = inner[0] + 2 * dot, inner[1] + 2 * dot
    # The first sample of the square around a point, counted from the border's edge.
    column, row = np.floor(screen[:, 0] + (1 + dot / 2)), np.floor(screen[:, 1] + (1 + dot / 2))
    order = np.flatnonzero((depth > 0) & (column >= 0) & (column < wide) & (row >= 0) & (row < high))
    # In 65,536 steps, which are sorted in a tenth of the time of floating point.
    nearness = np.round(65_535 * (depth[order].max() - depth[order]) / max(np.ptp(depth[order]), 1e-30))
    order = order[np.argsort(nearness.astype(np.uint16), kind="stable")]
    rank = np.zeros((high, wide), np.float32)
    # Of places that are named twice numpy keeps the last, which is the nearest point.
    places_in_it = row[order].astype(np.int64) * wide + column[order].astype(np.int64)
    rank.reshape(-1)[places_in_it] = np.arange(1, len(order) + 1, dtype=np.float32)
    covered = cv2.dilate(rank, np.ones((dot, dot), np.uint8), anchor=(dot - 1, dot - 1))
    shown = np.asarray(covered)[dot : dot + inner[1], dot : dot + inner[0]].astype(np.int64)
    palette = np.concatenate([np.array([background], np.uint8), paints[good[order]]])
    sampled = palette[shown]
    if inner == size:
        return np.asarray(sampled)
    return np.asarray(cv2.resize(sampled, size, interpolation=cv2.INTER_AREA), np.uint8)
