"""How flat the table and how round the wall of the cup in rigs/cup come out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_gpu.errors import InputError
from stereo_gpu.evaluation.meshes import depth_map, frame_of
from stereo_gpu.rig import Camera, Rig
from stereo_gpu.types import Doubles, RectifiedPair, Surface, View

# On the rectified right view of the rig that its owner published: the part of the board on the table that both
# cameras see, and the cup's wall, up to where it turns away from the cameras.
BOARD = ((179, 420), (470, 441), (411, 466), (145, 445))
WALL = ((318, 222), (436, 222), (436, 285), (318, 285))


def cup_rig(folder: Path) -> Rig:
    """The rig as its owner published it.

    Raises:
        InputError: its file is not there.
    """
    path = folder / "published_opencv.yml"
    if not path.is_file():
        raise InputError(f"{path} is missing: set STEREO_GPU_DATA to the folder of real pictures")
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    values = {name: file.getNode(name).mat() for name in ("K1", "D1", "K2", "D2", "R", "T")}
    cameras = [Camera(values[f"K{i}"], values[f"D{i}"].ravel(), (640, 480)) for i in (1, 2)]
    return Rig(cameras[0], cameras[1], values["R"], values["T"].ravel(), 0.0, 0.0, ())


@dataclass(frozen=True, kw_only=True)
class CupErrors:
    """A mesh of the cup on its table: rms distances in mm, over the pixels that all the meshes cover.

    Args:
        faces: triangles.
        table: from the plane that fits the board on the table best.
        wall: from the body of revolution that fits the cup's wall best.
    """

    faces: int
    table: float
    wall: float


def measure_cup(steps: Mapping[str, Surface], pair: RectifiedPair) -> dict[str, CupErrors]:
    """How flat and how round meshes of the right view are."""
    maps = {name: depth_map(surface, pair, View.RIGHT) for name, surface in steps.items()}
    shown = np.all([np.isfinite(depth) for depth in maps.values()], axis=0)
    return {
        name: CupErrors(
            faces=len(steps[name].faces),
            table=plane_residual(_points(depth, shown, pair, BOARD)),
            wall=wall_residual(_points(depth, shown, pair, WALL)),
        )
        for name, depth in maps.items()
    }


def plane_residual(points: Doubles) -> float:
    """Rms distance of points (N, 3) from the plane that fits them best."""
    return float(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[2] / np.sqrt(len(points)))


def wall_residual(points: Doubles) -> float:
    """Rms distance of points (N, 3) from the best body of revolution whose radius is quadratic along its axis.

    The axis is upright or leaning, as the camera's y is taken for nearly so.
    """
    from scipy.optimize import least_squares

    middle = points.mean(axis=0)
    local = points - middle

    def off(values: Doubles) -> Doubles:
        lean_x, lean_z, x, z, radius, taper, bend = values
        axis = np.array([lean_x, 1.0, lean_z])
        axis /= np.linalg.norm(axis)
        away = local - np.array([x, 0.0, z])
        along = away @ axis
        across = np.linalg.norm(away - along[:, None] * axis, axis=1)
        return np.asarray(across - radius - taper * along - bend * along**2)

    # Seen from the outside: the axis is behind the wall.
    start = np.array([0.0, 0.0, 0.0, 50.0, 60.0, 0.0, 0.0])
    fit = least_squares(off, start, x_scale=[0.1, 0.1, 10, 10, 10, 0.1, 0.01], loss="soft_l1", f_scale=1.0)
    return float(np.sqrt(np.square(off(fit.x)).mean()))


def _points(
    depth: Doubles, shown: NDArray[np.bool_], pair: RectifiedPair, outline: tuple[tuple[int, int], ...]
) -> Doubles:
    inside = cv2.fillPoly(np.zeros(depth.shape, np.uint8), [np.array(outline, np.int32)], 1) != 0
    y, x = np.nonzero(inside & shown)
    away = pair.focal_px * pair.baseline / depth[y, x]
    corners = np.column_stack([x - pair.cx_right, y - pair.cy, away])
    return frame_of(pair, View.RIGHT).place(corners).astype(np.float64)
