"""Vertices as the reference view measures them: column, row and disparity, all in px."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereo_gpu.errors import InputError, StageError
from stereo_gpu.types import Doubles, Floats


@dataclass(frozen=True)
class ViewFrame:
    """The view's camera, for going there and back.

    In this frame a plane is a plane, a pixel of disparity counts like a pixel across, the noise of stereo is the same
    everywhere and along the third axis alone, and a surface that the view sees is a height over the picture. Columns
    and rows count from the principal point; the disparity is the one of parallel cameras, focal_px baseline / depth.

    Args:
        focal_px: focal length of the rectified cameras.
        baseline: distance between them, in the vertices' unit.
        centre: where the view's camera stands, in the vertices' frame.
    """

    focal_px: float
    baseline: float
    centre: tuple[float, float, float]

    def __post_init__(self) -> None:
        if not (self.focal_px > 0 and self.baseline > 0):
            raise InputError(f"focal_px {self.focal_px}, baseline {self.baseline}: pass those of the pair, above 0")

    def see(self, vertices: Floats | Doubles) -> Doubles:
        """(N, 3) float64 column, row and disparity in px of (N, 3) vertices.

        Raises:
            StageError: one is not finite or not before the camera.
        """
        x, y, z = (vertices.astype(np.float64) - np.asarray(self.centre, np.float64)).T
        if not (np.isfinite(x).all() and np.isfinite(y).all() and np.isfinite(z).all() and (z > 0).all()):
            raise StageError("a vertex of the mesh is not finite or not before the camera: build the mesh again")
        scale = self.focal_px / z
        return np.stack([x * scale, y * scale, self.baseline * scale], axis=1)

    def place(self, corners: Doubles) -> Floats:
        """(N, 3) float32 vertices, from what `see` gives."""
        depth = self.focal_px * self.baseline / corners[:, 2]
        scale = depth / self.focal_px
        local = np.stack([corners[:, 0] * scale, corners[:, 1] * scale, depth], axis=1)
        return (local + np.asarray(self.centre, np.float64)).astype(np.float32)
