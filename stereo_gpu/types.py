"""What passes between the stages, and the conventions they share.

Pictures: uint8 or uint16, (H, W) or (H, W, 3) in RGB order; pixel centres at whole numbers.
Disparity d in px: left(x, y) shows what right(x - d, y) shows. No value is NaN, and `Validity` says why.
Lengths: the board's unit, millimetres unless told otherwise; without a rig, baselines.
Camera frame: x right, y down, z forward; X_right = R X_left + T.
Points, vertices: the frame of the rectified left camera, whichever view is the reference.
Texture coordinates: (0, 0) is the top left corner of the texture, (1, 1) its bottom right one.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntFlag, StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8] | NDArray[np.uint16]
Floats = NDArray[np.float32]
Doubles = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Ints = NDArray[np.int32]

METRES_PER_UNIT = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}
UNSCALED = "baselines"  # the unit of a reconstruction without a rig: the distance between the cameras


class Validity(IntFlag):
    """Why a pixel has no disparity, or that its disparity was filled in; 0 is a good pixel."""

    OUT_OF_RANGE = 1  # nothing in the searched range correlates
    TEXTURELESS = 2  # the window is flat
    OCCLUDED = 4  # the other camera cannot see it
    MISMATCH = 8  # the other view disagrees
    MASKED = 16  # outside the mask or outside the camera's picture
    FILLED = 32  # has a value, taken from its neighbours; another bit says why it had none of its own


class View(StrEnum):
    """Which picture a disparity map is laid out on."""

    LEFT = "left"
    RIGHT = "right"


@dataclass(frozen=True, kw_only=True)
class RectifiedPair:
    """Two pictures whose rows correspond, and the geometry that turns disparity into depth.

    Args:
        left, right: pictures of one size, (H, W) or (H, W, 3).
        valid_left, valid_right: (H, W) uint8, 1 where the picture has content.
        rotation_left, rotation_right: (3, 3), raw camera frame to rectified frame.
        focal_px: focal length of both rectified cameras, px.
        baseline: distance between the cameras, in `unit`.
        cx_left, cx_right, cy: principal points, px.
    """

    left: Picture
    right: Picture
    valid_left: Bytes
    valid_right: Bytes
    rotation_left: Doubles
    rotation_right: Doubles
    focal_px: float
    baseline: float
    cx_left: float
    cx_right: float
    cy: float
    unit: str = "mm"

    @classmethod
    def from_geometry(
        cls,
        left: Picture,
        right: Picture,
        *,
        focal_px: float,
        baseline: float,
        cx_left: float,
        cx_right: float,
        cy: float,
        unit: str = "mm",
    ) -> RectifiedPair:
        """Wrap pictures that are rectified already, such as Middlebury's, with their published geometry."""
        everywhere = np.ones(left.shape[:2], np.uint8)
        return cls(
            left=left,
            right=right,
            valid_left=everywhere,
            valid_right=everywhere,
            rotation_left=np.eye(3),
            rotation_right=np.eye(3),
            focal_px=focal_px,
            baseline=baseline,
            cx_left=cx_left,
            cx_right=cx_right,
            cy=cy,
            unit=unit,
        )


@dataclass(frozen=True, kw_only=True)
class Disparity:
    """A disparity map on the reference view.

    Args:
        values: (H, W) float32, px; NaN where there is none.
        validity: (H, W) uint8, bits of `Validity`; 0 is a good pixel.
        confidence: (H, W) float32 in 0..1; 0 where there is no value or a filled one.
        reference: the view that the map is laid out on.
        smallest, disparities: the searched range, [smallest, smallest + disparities).
        backend, device: where it was computed.
        options: every option as used.
        seconds: wall time of each step.
    """

    values: Floats
    validity: Bytes
    confidence: Floats
    reference: View
    smallest: int
    disparities: int
    backend: str
    device: str
    options: dict[str, Any] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def coverage(self) -> float:
        """Share of the pixels that are not masked which have a value."""
        wanted = (self.validity & Validity.MASKED) == 0
        return float(np.isfinite(self.values[wanted]).mean()) if wanted.any() else 0.0


@dataclass(frozen=True, kw_only=True)
class Surface:
    """A triangle mesh on the pixels of the reference view, not yet textured.

    Args:
        vertices: (N, 3) float32, in the pair's unit, frame of the rectified left camera.
        faces: (M, 3) int32, counter-clockwise seen from the cameras.
    """

    vertices: Floats
    faces: Ints


@dataclass(frozen=True, kw_only=True)
class Mesh:
    """A textured triangle mesh.

    Args:
        vertices: (N, 3) float32, in `unit`, frame of the rectified left camera.
        faces: (M, 3) int32, counter-clockwise seen from the cameras.
        uv: (N, 2) float32 in 0..1, origin at the texture's top left corner.
        texture: (S, T, 3) uint8, RGB.
    """

    vertices: Floats
    faces: Ints
    uv: Floats
    texture: Bytes
    unit: str = "mm"
