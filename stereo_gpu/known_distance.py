"""One known distance between two places in a picture sets the scale of a reconstruction without a rig."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import cv2
import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.rig import Camera, Rig
from stereo_gpu.types import Doubles, Floats, RectifiedPair, View

AROUND = 3  # px on either side of a place, whose points are taken together


@dataclass(frozen=True)
class KnownDistance:
    """Two places in the raw reference picture and how far they are apart.

    Args:
        first, second: column and row, px.
        length: their distance, in `unit`.
        unit: of the scaled reconstruction.

    Raises:
        InputError: the places are one, or the length is none.
    """

    first: tuple[float, float]
    second: tuple[float, float]
    length: float
    unit: str = "mm"

    def __post_init__(self) -> None:
        numbers = (*self.first, *self.second, self.length)
        if not all(math.isfinite(number) for number in numbers):
            raise InputError(f"distance = {','.join(f'{n:g}' for n in numbers)}: give finite numbers")
        if not self.length > 0:
            raise InputError(f"distance = {self.length:g} {self.unit}: give a length above 0")
        if self.first == self.second:
            raise InputError(f"both ends of the distance are at {self.first}: give two places")

    def refuse_outside(self, size: tuple[int, int]) -> None:
        """Refuse places that a picture does not have; the lens model would carry them anywhere.

        Args:
            size: width and height of the raw pictures, px.

        Raises:
            InputError: a place lies outside.
        """
        width, height = size
        for x, y in (self.first, self.second):
            if not (-0.5 <= x <= width - 0.5 and -0.5 <= y <= height - 0.5):
                raise InputError(
                    f"the distance ends at ({x:g}, {y:g}), outside of the pictures of {width} x {height} px:"
                    " give places in the raw reference picture"
                )


def scale_to(
    known: KnownDistance, pair: RectifiedPair, points: Floats, rig: Rig, view: View
) -> tuple[RectifiedPair, Floats]:
    """Give a reconstruction the scale that a known distance has in it.

    Args:
        known: places in the raw picture of the reference view.
        pair, points: of any scale; (H, W, 3) on the reference view, NaN where there is none.
        rig: whose raw pictures they were made of.
        view: the reference view.

    Returns:
        Both in the known distance's unit.

    Raises:
        InputError: a place lies outside of the picture, or no depth is known around it.
    """
    camera, rotation, cx = rig.left, pair.rotation_left, pair.cx_left
    if view is View.RIGHT:
        camera, rotation, cx = rig.right, pair.rotation_right, pair.cx_right
    matrix = np.array([[pair.focal_px, 0, cx], [0, pair.focal_px, pair.cy], [0, 0, 1]])
    scale = scale_of(known, points, camera, rotation, matrix)
    return dataclasses.replace(pair, baseline=pair.baseline * scale, unit=known.unit), points * np.float32(scale)


def scale_of(known: KnownDistance, points: Floats, camera: Camera, rotation: Doubles, matrix: Doubles) -> float:
    """How many of the known distance's units one unit of the points is.

    Args:
        known: places in the raw picture.
        points: (H, W, 3) on the rectified reference view, NaN where there is none.
        camera: that took the raw picture.
        rotation: (3, 3), its frame to the rectified one.
        matrix: (3, 3) of the rectified camera.

    Raises:
        InputError: a place lies outside of the picture, or no depth is known around it.
    """
    known.refuse_outside(camera.size)
    places = np.array([known.first, known.second], np.float64).reshape(-1, 1, 2)
    rectified = cv2.undistortPoints(places, camera.matrix, camera.distortion, R=rotation, P=matrix).reshape(2, 2)
    ends = [_point(points, place, raw) for place, raw in zip(rectified, (known.first, known.second), strict=True)]
    apart = float(np.linalg.norm(ends[0] - ends[1]))
    if not apart > 0:
        raise InputError(f"the places {known.first} and {known.second} are one point of the model: choose others")
    return known.length / apart


def _point(points: Floats, place: Doubles, raw: tuple[float, float]) -> Doubles:
    """The median point around a place."""
    height, width = points.shape[:2]
    x, y = np.round(place).astype(int)
    if not (0 <= x < width and 0 <= y < height):
        raise InputError(
            f"the distance ends at ({raw[0]:g}, {raw[1]:g}), outside of what both rectified pictures show:"
            " choose a place nearer to the middle"
        )
    around = points[max(0, y - AROUND) : y + AROUND + 1, max(0, x - AROUND) : x + AROUND + 1].reshape(-1, 3)
    around = around[np.isfinite(around).all(axis=1)]
    if not len(around):
        raise InputError(
            f"no depth is known at ({raw[0]:g}, {raw[1]:g}), where the distance ends: choose another place"
        )
    return np.median(around.astype(np.float64), axis=0)
