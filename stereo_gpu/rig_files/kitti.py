"""KITTI's calibrations: projections P0 to P3 (odometry, objects), and calib_cam_to_cam.txt (raw data, stereo 2015).

A. Geiger, P. Lenz, C. Stiller, R. Urtasun, Vision meets robotics: the KITTI dataset, IJRR 2013, section 4. Cameras 0
and 1 are the grey pair, 2 and 3 the one in colour; lengths in metres.
"""

from __future__ import annotations

import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.rig_files.draft import Draft, DraftCamera, Size
from stereo_gpu.rig_files.geometry import mend_rotation, shift
from stereo_gpu.rig_files.tree import Tree, matrix, whole
from stereo_gpu.types import Doubles

PAIRS = ((2, 3), (0, 1))  # the pair in colour first


def read_kitti(values: dict[str, Tree], size: Size | None, cameras: tuple[int, int] | None) -> Draft:
    """A rig from the lines of one file.

    calib_cam_to_cam.txt holds every camera twice, as it is and rectified: `size` of the rectified pictures asks for
    those, any other one, or none, for the raw ones.

    Args:
        values: the lines.
        size: of the pictures, px.
        cameras: numbers of the left and the right camera; None takes 2 and 3, and 0 and 1 where those are missing.

    Raises:
        InputError: a value is missing or wrong, or there are no such cameras.
    """
    raw = any(name.startswith("K_") for name in values)
    names = "P_rect_{:02d}" if _asks_rectified(values, size) or not raw else "K_{:02d}"
    if "P0" in values or "P2" in values:
        names = "P{}"
    pairs = PAIRS if cameras is None else (cameras,)
    pair = next((pair for pair in pairs if all(names.format(number) in values for number in pair)), None)
    if pair is None:
        wanted = " or ".join(f"{names.format(left)} and {names.format(right)}" for left, right in pairs)
        raise InputError(f"it has no {wanted}: is it KITTI's, and are these its cameras?")
    return _from_raw(values, pair) if names.startswith("K") else _from_projections(values, names, pair)


def _asks_rectified(values: dict[str, Tree], size: Size | None) -> bool:
    sizes = [_size(name, values) for name in sorted(values) if name.startswith("S_rect_")]
    return size is not None and tuple(size) in sizes


def _from_projections(values: dict[str, Tree], names: str, pair: tuple[int, int]) -> Draft:
    """Rectified cameras: P = K [1 | t], no lens, no rotation."""
    projections = [matrix(names.format(number), values[names.format(number)], (3, 4)) for number in pair]
    shifts = [shift(names.format(number), projection) for number, projection in zip(pair, projections, strict=True)]
    left, right = (
        DraftCamera(matrix=projection[:, :3], distortion=np.zeros(5), size=_size(f"S_rect_{number:02d}", values))
        for number, projection in zip(pair, projections, strict=True)
    )
    return Draft(left=left, right=right, R=np.eye(3), T=shifts[1] - shifts[0], unit="m")


def _from_raw(values: dict[str, Tree], pair: tuple[int, int]) -> Draft:
    """Raw cameras; R_xx and T_xx lead from camera 0 to camera xx."""
    cameras, turns, moves = [], [], []
    for number in pair:
        cameras.append(
            DraftCamera(
                matrix=_matrix(values, f"K_{number:02d}", (3, 3)),
                distortion=_matrix(values, f"D_{number:02d}", (5,)),
                size=_size(f"S_{number:02d}", values),
            )
        )
        turns.append(mend_rotation(f"R_{number:02d}", _matrix(values, f"R_{number:02d}", (3, 3))))
        moves.append(_matrix(values, f"T_{number:02d}", (3,)))
    rotation = turns[1] @ turns[0].T
    return Draft(left=cameras[0], right=cameras[1], R=rotation, T=moves[1] - rotation @ moves[0], unit="m")


def _matrix(values: dict[str, Tree], name: str, shape: tuple[int, ...]) -> Doubles:
    if name not in values:
        raise InputError(f"it has no {name}: is it cut off?")
    return matrix(name, values[name], shape)


def _size(name: str, values: dict[str, Tree]) -> Size | None:
    if name not in values:
        return None
    wide, high = matrix(name, values[name], (2,)).tolist()
    return whole(name, wide), whole(name, high)
