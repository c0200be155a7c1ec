"""ROS's camera_info: two YAML files as camera_calibration of image_pipeline writes them, lengths in metres.

A file holds one camera: K and its lens, the rotation to the rectified frame and the projection of the rectified
camera, P = K' [1 | t] (sensor_msgs/CameraInfo). R and T follow from both files:
x_rectified = R_left x_left = R_right x_right - t_right + t_left.
"""

from __future__ import annotations

import logging

import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.rig_files.draft import Draft, DraftCamera
from stereo_gpu.rig_files.geometry import mend_rotation, shift
from stereo_gpu.rig_files.tree import Tree, matrix, number, shorten, whole
from stereo_gpu.types import METRES_PER_UNIT, Doubles

MODELS = {"plumb_bob": ((5,), (4,)), "rational_polynomial": ((8,), (12,), (14,))}
EXACT = "stereo_gpu"  # our own entry in the right file, which ROS passes over: R and T before rounding
ROUNDING = 1e-9  # what R and T lose in R_left, R_right and P: of a radian, and of T's length

logger = logging.getLogger(__name__)


def is_ros(tree: Tree) -> bool:
    """Whether this is a camera_info file."""
    return isinstance(tree, dict) and "camera_matrix" in tree and "projection_matrix" in tree


def read_ros(left: Tree, right: Tree) -> Draft:
    """A rig from the files of its two cameras.

    Raises:
        InputError: a part is missing or wrong, the files are swapped, or the lens model is another one.
    """
    cameras = [_camera(name, tree) for name, tree in (("left", left), ("right", right))]
    (turn_left, shift_left), (turn_right, shift_right) = (
        _rectified(name, tree) for name, tree in (("left", left), ("right", right))
    )
    apart = shift_right - shift_left
    if apart[0] > 0 and np.abs(apart).max() == apart[0]:
        raise InputError("projection_matrix says that left and right are swapped: give the left camera's file first")
    rotation, translation = turn_right.T @ turn_left, turn_right.T @ apart
    unit = "m"
    exact = _exact(right)
    if exact is not None:
        turn, move, its_unit = exact
        metres = move * METRES_PER_UNIT[its_unit]
        far = float(np.abs(metres - translation).max())
        if np.abs(turn - rotation).max() <= ROUNDING and far <= ROUNDING * float(np.linalg.norm(metres)):
            rotation, translation, unit = turn, move, its_unit
        else:
            logger.warning("the entry %s does not agree with the matrices beside it and is not used", EXACT)
    return Draft(left=cameras[0], right=cameras[1], R=rotation, T=translation, unit=unit)


def _camera(name: str, tree: Tree) -> DraftCamera:
    # Files from before there were models have none and mean plumb_bob, as ROS's own reader takes it.
    model = tree.get("distortion_model", "plumb_bob") if isinstance(tree, dict) else "none"
    shapes = MODELS.get(model) if isinstance(model, str) else None
    if shapes is None:
        raise InputError(
            f"{name} camera has distortion_model {shorten(model)}: only {' and '.join(MODELS)} are supported;"
            " calibrate again with one of them"
        )
    width, height = (
        whole(f"{name} {key}", number(f"{name} {key}", _part(name, tree, key)))
        for key in ("image_width", "image_height")
    )
    return DraftCamera(
        matrix=matrix(f"{name} camera_matrix", _part(name, tree, "camera_matrix"), (3, 3)),
        distortion=matrix(f"{name} distortion_coefficients", _part(name, tree, "distortion_coefficients"), *shapes),
        size=(width, height),
    )


def _rectified(name: str, tree: Tree) -> tuple[Doubles, Doubles]:
    """Rotation to the rectified frame, and the shift in it, metres."""
    key = f"{name} rectification_matrix"
    rotation = mend_rotation(key, matrix(key, _part(name, tree, "rectification_matrix"), (3, 3)))
    key = f"{name} projection_matrix"
    return rotation, shift(key, matrix(key, _part(name, tree, "projection_matrix"), (3, 4)))


def _exact(tree: Tree) -> tuple[Doubles, Doubles, str] | None:
    part = tree.get(EXACT) if isinstance(tree, dict) else None
    if part is None:
        return None
    unit = _part(EXACT, part, "unit")
    if not isinstance(unit, str) or unit not in METRES_PER_UNIT:
        raise InputError(f"{EXACT}.unit is {shorten(unit)}: give one of {', '.join(METRES_PER_UNIT)}")
    rotation = matrix(f"{EXACT}.rotation", _part(EXACT, part, "rotation"), (3, 3))
    return rotation, matrix(f"{EXACT}.translation", _part(EXACT, part, "translation"), (3,)), unit


def _part(name: str, tree: Tree, key: str) -> Tree:
    if not isinstance(tree, dict) or key not in tree:
        raise InputError(f"{name} file has no {key}: is it a camera_info file of image_pipeline?")
    return tree[key]
