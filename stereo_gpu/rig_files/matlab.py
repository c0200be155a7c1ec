"""Calib_Results_stereo.mat of the Camera Calibration Toolbox for Matlab (J.-Y. Bouguet).

om, R and T lead from the left to the right camera's frame, as ours; the lens is kc = k1 k2 p1 p2 k3, as OpenCV's.
The toolbox counts pixels from 0 (click_calib.m takes 1 off Matlab's corners), so its principal point is ours too.
Its uncertainties, *_error, are three standard deviations.
"""

from __future__ import annotations

import logging

import numpy as np

from stereo_gpu.deviations import CameraDeviations, Deviations
from stereo_gpu.errors import InputError
from stereo_gpu.rig_files.draft import Draft, DraftCamera, Size
from stereo_gpu.rig_files.mat_variables import read_variables
from stereo_gpu.rig_files.tree import whole
from stereo_gpu.types import Doubles

DEVIATIONS = 3.0  # standard deviations in one of the toolbox's uncertainties
LARGEST_SKEW = 1e-5  # alpha_c: 0.01 px over 1000 px
AGREEMENT = 1e-4  # largest difference of R from what om gives: both are saved with every digit
CAMERA_NAMES = ("fc", "cc", "kc", "alpha_c")

logger = logging.getLogger(__name__)


def read_matlab(data: bytes) -> Draft:
    """A rig from the bytes of a .mat file.

    Raises:
        InputError: it is no such file, damaged, or holds a camera that is not supported.
    """
    sides = ("left", "right")
    names = [f"{name}_{side}{end}" for name in CAMERA_NAMES for side in sides for end in ("", "_error")]
    found = read_variables(data, [*names, "om", "om_error", "T", "T_error", "R", "nx", "ny"], ["unit"])
    values = found.numbers
    size = _size(values)
    cameras = [_camera(values, side, size) for side in sides]
    return Draft(
        left=cameras[0],
        right=cameras[1],
        R=_rotation(values),
        T=_vector(values, "T", 3),
        unit=found.texts.get("unit"),
        deviations=_deviations(values),
    )


def _size(values: dict[str, Doubles]) -> Size | None:
    if "nx" not in values and "ny" not in values:
        return None
    wide, high = (float(_vector(values, name, 1)[0]) for name in ("nx", "ny"))
    return whole("nx", wide), whole("ny", high)


def _camera(values: dict[str, Doubles], side: str, size: Size | None) -> DraftCamera:
    focal, centre = _vector(values, f"fc_{side}", 2), _vector(values, f"cc_{side}", 2)
    skew = float(_vector(values, f"alpha_c_{side}", 1)[0]) if f"alpha_c_{side}" in values else 0.0
    if abs(skew) > LARGEST_SKEW:
        raise InputError(
            f"alpha_c_{side} is {skew:g}: only cameras without skew are supported; set est_alpha to 0 and calibrate"
            " again"
        )
    if skew:
        logger.warning("alpha_c_%s is %g: taken as 0", side, skew)
    matrix = np.array([[focal[0], 0, centre[0]], [0, focal[1], centre[1]], [0, 0, 1]])
    return DraftCamera(matrix=matrix, distortion=_vector(values, f"kc_{side}", 5, 4), size=size)


def _rotation(values: dict[str, Doubles]) -> Doubles:
    """R, or what om gives; both must agree where both are there."""
    import cv2

    if "om" not in values:
        return _vector(values, "R", 9).reshape(3, 3)
    om = _vector(values, "om", 3)
    if not np.abs(om).max() <= 2 * np.pi:
        raise InputError(f"om is {om.tolist()!s:.60}: a rotation vector is at most one turn long")
    turned: Doubles = cv2.Rodrigues(om)[0]
    if "R" not in values:
        return turned
    rotation = _vector(values, "R", 9).reshape(3, 3)
    if not np.abs(rotation - turned).max() <= AGREEMENT:
        raise InputError("R is another rotation than om: delete the one that is wrong")
    return rotation


def _deviations(values: dict[str, Doubles]) -> Deviations | None:
    """The toolbox's uncertainties, if it saved all of them."""
    needed = [f"{name}_{side}_error" for name in CAMERA_NAMES[:3] for side in ("left", "right")]
    if any(name not in values for name in [*needed, "om_error", "T_error"]):
        return None
    left, right = (
        CameraDeviations(
            **dict(zip(("fx", "fy"), (_vector(values, f"fc_{side}_error", 2) / DEVIATIONS).tolist(), strict=True)),
            **dict(zip(("cx", "cy"), (_vector(values, f"cc_{side}_error", 2) / DEVIATIONS).tolist(), strict=True)),
            distortion=_five(_vector(values, f"kc_{side}_error", 5, 4)) / DEVIATIONS,
        )
        for side in ("left", "right")
    )
    om, move = (_vector(values, f"{name}_error", 3) / DEVIATIONS for name in ("om", "T"))
    return Deviations(left=left, right=right, om=om, T=move)


def _five(coefficients: Doubles) -> Doubles:
    return np.append(coefficients, 0.0) if len(coefficients) == 4 else coefficients


def _vector(values: dict[str, Doubles], name: str, *counts: int) -> Doubles:
    """A variable's numbers, row by row."""
    if name not in values:
        raise InputError(f"it has no {name}: is it Calib_Results_stereo.mat of the toolbox?")
    found = values[name].reshape(-1)
    if len(found) not in counts:
        shape = " x ".join(map(str, values[name].shape))
        raise InputError(f"{name} has {shape} numbers: it must have {' or '.join(map(str, counts))}")
    if not np.isfinite(found).all():
        raise InputError(f"{name} has a value of {found[~np.isfinite(found)][0]}: it must be finite; mend the value")
    return found
