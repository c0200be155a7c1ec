"""Where to stand to look at a model: a camera on an orbit around its middle, framed to fit a picture.

Without yaw and pitch it stands where the rectified cameras do, so a surface shows as they saw it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stereo_gpu.errors import StageError
from stereo_gpu.types import Doubles, Ints

_SAMPLES = 20_000  # points that the framing looks at
_FACES = 50_000  # faces that they are drawn from: of more, every so many
# Per cent left out at either end of each axis when framing: matches that are wrong, in a cloud, and bits of a mesh.
CLOUD_OUTLIERS, MESH_OUTLIERS = 0.4, 0.2
_MARGIN = 1.08  # the frame against the box of what is left
_NEAREST = 0.05  # what comes closer to the camera than this part of the pivot's depth is not drawn


@dataclass(frozen=True, kw_only=True)
class Orbit:
    """A pinhole camera that looks at the scene turned about a pivot: p = focal * (x, y) / z + centre.

    Args:
        rotation: (3, 3), applied about the pivot.
        pivot: (3,) in the frame of the rectified left camera; its depth does not change.
        focal: px.
        centre: (2,) px, chosen so that the model stands in the middle of the picture.
    """

    rotation: Doubles
    pivot: Doubles
    focal: float
    centre: Doubles

    def turn(self, points: Doubles) -> Doubles:
        """Points (N, 3) in this camera's frame."""
        turned: Doubles = (points - self.pivot) @ self.rotation.T + self.pivot
        return turned

    def see(self, points: Doubles) -> tuple[Doubles, Doubles]:
        """Positions in the picture, (N, 2) px, and depths, (N,); a depth of 0 is too near or behind."""
        # Column by column: numpy walks rows of three at a fraction of the pace.
        x, y, z = self.rotation @ np.ascontiguousarray(points.T) + (self.pivot - self.rotation @ self.pivot)[:, None]
        near = z > _NEAREST * self.pivot[2]
        scale = self.focal / np.where(near, z, np.inf)
        screen = np.stack([x * scale + self.centre[0], y * scale + self.centre[1]]).T
        return screen, np.where(near, z, 0.0)


def orbit(
    points: Doubles, size: tuple[int, int], *, yaw: float = 0.0, pitch: float = 0.0, outliers: float = MESH_OUTLIERS
) -> Orbit:
    """Turn about the median of the points and choose the focal length so that they fill the picture.

    Args:
        points: (N, 3) with depths > 0.
        size: (width, height) of the picture, px.
        yaw: degrees that the camera walks to its right around the points.
        pitch: degrees that it rises above them.
        outliers: per cent of the points that may lie outside on each side.

    Raises:
        StageError: all points end up behind the camera.
    """
    return frame(points, size, [(yaw, pitch)], outliers=outliers)[0]


def frame(
    points: Doubles, size: tuple[int, int], views: Sequence[tuple[float, float]], *, outliers: float = MESH_OUTLIERS
) -> list[Orbit]:
    """The same for several views (yaw, pitch), degrees, with one focal length that fits them all.

    Raises:
        StageError: in one of them all points end up behind the camera.
    """
    pivot = np.median(points, axis=0)
    rotations = [_rotation(yaw, pitch) for yaw, pitch in views]
    bounds = []
    for (yaw, pitch), rotation in zip(views, rotations, strict=True):
        turned = (points - pivot) @ rotation.T + pivot
        turned = turned[turned[:, 2] > _NEAREST * pivot[2]]
        if not len(turned):
            raise StageError(f"yaw {yaw} and pitch {pitch} leave all of it behind the camera: choose smaller ones")
        rays = turned[:, :2] / turned[:, 2:]
        bounds.append(np.percentile(rays, [outliers, 100 - outliers], axis=0))
    extent = np.maximum(np.max([high - low for low, high in bounds], axis=0) * _MARGIN, 1e-6)
    focal = float(min(size[0] / extent[0], size[1] / extent[1]))
    middle = (np.array(size) - 1) / 2
    return [
        Orbit(rotation=rotation, pivot=pivot, focal=focal, centre=middle - focal * (low + high) / 2)
        for rotation, (low, high) in zip(rotations, bounds, strict=True)
    ]


def _rotation(yaw: float, pitch: float) -> Doubles:
    cos_yaw, sin_yaw = np.cos(np.radians(yaw)), np.sin(np.radians(yaw))
    cos_pitch, sin_pitch = np.cos(np.radians(pitch)), np.sin(np.radians(pitch))
    about_y = np.array([[cos_yaw, 0, sin_yaw], [0, 1, 0], [-sin_yaw, 0, cos_yaw]])
    about_x = np.array([[1, 0, 0], [0, cos_pitch, -sin_pitch], [0, sin_pitch, cos_pitch]])
    rotation: Doubles = about_x @ about_y
    return rotation


def spread(vertices: Doubles, faces: Ints) -> Doubles:
    """Vertices drawn in proportion to the area that their faces cover in the cameras' view, (N, 3).

    A decimated mesh has few vertices where it is flat, so counting vertices would crop its flat parts.
    """
    faces = faces[:: -(-len(faces) // _FACES)]
    flat = (vertices[:, :2] / np.where(vertices[:, 2:] > 0, vertices[:, 2:], np.inf))[faces]
    first, second = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    total = np.cumsum(np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) + 1e-15)
    picks = np.searchsorted(total, np.linspace(0, total[-1], _SAMPLES // 3, endpoint=False))
    drawn: Doubles = vertices[faces[picks]].reshape(-1, 3)
    return drawn
