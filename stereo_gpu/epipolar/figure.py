"""Two pictures with matched points and their epipolar lines, for looking at."""

from __future__ import annotations

import colorsys

import cv2
import numpy as np

from stereo_gpu.epipolar.points import cross_matrix, homogeneous
from stereo_gpu.epipolar.pose import undistort
from stereo_gpu.images import check_picture, grey
from stereo_gpu.rig import Camera, Rig
from stereo_gpu.types import Bytes, Doubles, Picture

SHOWN = 12  # lines: more cannot be told apart
ALONG = np.array([0.3, 1.0])  # what a distance counts in x and y: lines run along the rows, and are to lie apart
GOLDEN = 0.618  # of the circle of hues from one line to the next, so that neighbours differ
FADED = 0.55  # of the picture's contrast, towards white, so that thin lines stand out
PIECES = 64  # straight ones of a bent line
SHIFT = 4  # bits of a pixel's fraction in OpenCV's drawing


def draw_epipolar_lines(
    left: Picture, right: Picture, F: Doubles, points_left: Doubles, points_right: Doubles, *, count: int = SHOWN
) -> tuple[Bytes, Bytes]:
    """Mark matched points, and through each the epipolar line of its partner in the other picture.

    A point off its line by more than a pixel or so is a wrong match, or F is wrong.

    Args:
        left, right: (H, W) or (H, W, 3), uint8 or uint16; they may differ in size.
        F: (3, 3), x_right' F x_left = 0 for places in these very pictures.
        points_left, points_right: (N, 2) px; those farthest from each other are shown.
        count: how many, at most.

    Returns:
        Both pictures, (H, W, 3) uint8 RGB, faded under the lines; a point and its line have one colour in both.

    Raises:
        PictureError: one of them is no picture.
    """
    chosen = _spread(points_left, count)
    at_left, at_right = points_left[chosen], points_right[chosen]
    check_picture("left", left)
    check_picture("right", right)
    lines_left = [_clip(line, *_box(left)) for line in homogeneous(at_right) @ F]
    lines_right = [_clip(line, *_box(right)) for line in homogeneous(at_left) @ F.T]
    return _draw(left, at_left, lines_left), _draw(right, at_right, lines_right)


def draw_epipolar_curves(
    left: Picture, right: Picture, rig: Rig, points_left: Doubles, points_right: Doubles, *, count: int = SHOWN
) -> tuple[Bytes, Bytes]:
    """The same for the raw pictures of a rig, whose lenses bend the lines.

    Raises:
        PictureError: one of them is no picture.
    """
    chosen = _spread(points_left, count)
    at_left, at_right = points_left[chosen], points_right[chosen]
    check_picture("left", left)
    check_picture("right", right)
    E = cross_matrix(rig.T) @ rig.R
    of_right = homogeneous(undistort(at_right, rig.right)) @ E
    of_left = homogeneous(undistort(at_left, rig.left)) @ E.T
    return (
        _draw(left, at_left, [_bend(line, rig.left) for line in of_right]),
        _draw(right, at_right, [_bend(line, rig.right) for line in of_left]),
    )


def _spread(points: Doubles, count: int) -> list[int]:
    """Numbers of points of which each is as far as can be from those before, the most central one first."""
    if not len(points):
        return []
    places = points * ALONG
    chosen = [int(np.linalg.norm(places - np.median(places, axis=0), axis=1).argmin())]
    distances = np.full(len(points), np.inf)
    while len(chosen) < min(count, len(points)):
        distances = np.minimum(distances, np.linalg.norm(places - places[chosen[-1]], axis=1))
        chosen.append(int(distances.argmax()))
    return chosen


def _colour(number: int) -> tuple[int, int, int]:
    red, green, blue = colorsys.hls_to_rgb(number * GOLDEN % 1, 0.4, 0.9)
    return int(255 * red), int(255 * green), int(255 * blue)


def _draw(picture: Picture, points: Doubles, lines: list[Doubles]) -> Bytes:
    """A faded copy of the picture with lines, each (M, 2) px, and the point of each."""
    flat = grey(picture)
    faded = 255 - FADED * (255 - flat.astype(np.float32))
    drawn = cv2.cvtColor(faded.astype(np.uint8), cv2.COLOR_GRAY2RGB)
    thick = max(1, round(max(flat.shape) / 600))
    for number, line in enumerate(lines):
        corners = np.rint(line * (1 << SHIFT)).astype(np.int32).reshape(-1, 1, 2)
        cv2.polylines(drawn, [corners], False, _colour(number), thick, cv2.LINE_AA, SHIFT)
    for number, (x, y) in enumerate(np.rint(points * (1 << SHIFT)).astype(int).tolist()):
        for radius, fill, width in ((4, (255, 255, 255), -1), (4, _colour(number), thick), (1, _colour(number), -1)):
            cv2.circle(drawn, (x, y), radius * thick << SHIFT, fill, width, cv2.LINE_AA, SHIFT)
    result: Bytes = drawn
    return result


def _box(picture: Picture) -> tuple[Doubles, Doubles]:
    """The first and the last place of a picture, px."""
    return np.zeros(2), np.array([picture.shape[1] - 1.0, picture.shape[0] - 1.0])


def _clip(line: Doubles, low: Doubles, high: Doubles) -> Doubles:
    """Where the line a x + b y + c = 0 enters and leaves the box, (2, 2); (0, 2) where it misses it."""
    a, b, c = line
    size = np.hypot(a, b)
    if not size > 0:
        return np.zeros((0, 2))
    # From the foot of the perpendicular both ways, until the first side is crossed.
    foot, along = np.array([-a * c, -b * c]) / size**2, np.array([-b, a]) / size
    first, last = -np.inf, np.inf
    for start, step, near, far in zip(foot, along, low, high, strict=True):
        if step == 0:
            if not near <= start <= far:
                return np.zeros((0, 2))
            continue
        one, other = sorted(((near - start) / step, (far - start) / step))
        first, last = max(first, one), min(last, other)
    return np.array([foot + first * along, foot + last * along]) if first < last else np.zeros((0, 2))


def _bend(line: Doubles, camera: Camera) -> Doubles:
    """A line of undistorted x / z, y / z as this camera's picture shows it, (M, 2) px."""
    width, height = camera.size
    # No farther than the picture's own border: beyond it the lens model may fold back.
    across, down = np.linspace(0, width - 1, 33), np.linspace(0, height - 1, 33)
    border = [np.column_stack([across, np.full(33, side)]) for side in (0, height - 1)]
    border += [np.column_stack([np.full(33, side), down]) for side in (0, width - 1)]
    seen = undistort(np.concatenate(border), camera)
    ends = _clip(line, seen.min(axis=0), seen.max(axis=0))
    if not len(ends):
        return ends
    rays = ends[0] + np.linspace(0, 1, PIECES + 1)[:, None] * (ends[1] - ends[0])
    bent: Doubles = cv2.projectPoints(homogeneous(rays), np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)[0]
    return bent.reshape(-1, 2)
