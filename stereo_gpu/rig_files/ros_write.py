"""ROS's camera_info of both cameras, as `read_ros` reads it."""

from __future__ import annotations

import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.rectify import plan_rectification
from stereo_gpu.rig import Camera, Rig
from stereo_gpu.rig_files.opencv_write import digits
from stereo_gpu.rig_files.ros import EXACT
from stereo_gpu.types import METRES_PER_UNIT, Doubles


def write_ros(rig: Rig) -> tuple[str, str]:
    """The texts of left.yaml and right.yaml, the rectified cameras being those of `rectify`.

    Raises:
        InputError: the rig's unit is unknown, its lens has no name in ROS, or its cameras stand above each other.
    """
    if rig.unit not in METRES_PER_UNIT:
        raise InputError(
            f"unit is {rig.unit!r}, and ROS counts metres: only {', '.join(METRES_PER_UNIT)} can be written"
        )
    for name, camera in (("left", rig.left), ("right", rig.right)):
        if len(camera.distortion) > 8:
            raise InputError(
                f"{name} lens has {len(camera.distortion)} coefficients, ROS has names for 5 and 8:"
                " calibrate with --coefficients 8"
            )
    plan = plan_rectification(rig)
    move = -plan.focal_px * plan.baseline * METRES_PER_UNIT[rig.unit]
    left = _text("left", rig.left, plan.rotation_left, [plan.focal_px, plan.cx_left, plan.cy, 0.0])
    right = _text("right", rig.right, plan.rotation_right, [plan.focal_px, plan.cx_right, plan.cy, move])
    own = [f"{EXACT}:", *_lines("  rotation", rig.R), *_lines("  translation", rig.T.reshape(3, 1))]
    return left, right + "\n".join([*own, f"  unit: {rig.unit}"]) + "\n"


def _text(name: str, camera: Camera, rotation: Doubles, rectified: list[float]) -> str:
    focal, cx, cy, move = rectified
    model = "plumb_bob" if len(camera.distortion) == 5 else "rational_polynomial"
    lines = [f"image_width: {camera.size[0]}", f"image_height: {camera.size[1]}", f"camera_name: {name}"]
    lines += [*_lines("camera_matrix", camera.matrix), f"distortion_model: {model}"]
    lines += _lines("distortion_coefficients", camera.distortion.reshape(1, -1))
    lines += _lines("rectification_matrix", rotation)
    projection = np.array([[focal, 0, cx, move], [0, focal, cy, 0], [0, 0, 1, 0]])
    return "\n".join([*lines, *_lines("projection_matrix", projection)]) + "\n"


def _lines(name: str, values: Doubles) -> list[str]:
    inner = " " * (len(name) - len(name.lstrip()) + 2)
    numbers = ", ".join(digits(value) for value in values.ravel().tolist())
    return [f"{name}:", f"{inner}rows: {len(values)}", f"{inner}cols: {values.shape[1]}", f"{inner}data: [{numbers}]"]
