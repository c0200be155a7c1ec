"""How certain a calibration is of every number that it gives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.types import Doubles

COEFFICIENT_NAMES = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4")


@dataclass(frozen=True, eq=False, kw_only=True)
class CameraDeviations:
    """Standard deviations of one camera's parameters.

    Args:
        fx, fy, cx, cy: px.
        distortion: (n,) float64, in the order of `Camera.distortion`.

    Raises:
        InputError: a value is no such number.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    distortion: Doubles

    def __post_init__(self) -> None:
        for name in ("fx", "fy", "cx", "cy"):
            object.__setattr__(self, name, float(_deviations(name, getattr(self, name), ())))
        shape = count_shape(self.distortion)
        if len(shape) != 1 or not 0 < shape[0] <= len(COEFFICIENT_NAMES):
            raise InputError(f"distortion has shape {shape}: give one deviation for each coefficient of the lens")
        object.__setattr__(self, "distortion", _deviations("distortion", self.distortion, shape))


@dataclass(frozen=True, eq=False, kw_only=True)
class Deviations:
    """Standard deviations of a rig's parameters, as its calibration's residuals and geometry give them.

    Args:
        left, right: the cameras.
        om: (3,) rad, of the rotation vector of R.
        T: (3,), in the rig's unit.

    Raises:
        InputError: a value is no such number.
    """

    left: CameraDeviations
    right: CameraDeviations
    om: Doubles
    T: Doubles

    def __post_init__(self) -> None:
        for name in ("om", "T"):
            object.__setattr__(self, name, _deviations(name, getattr(self, name), (3,)))

    def as_json(self) -> dict[str, Any]:
        """Plain numbers and lists, with every digit."""
        return {
            **{name: _camera_json(getattr(self, name)) for name in ("left", "right")},
            "om": self.om.tolist(),
            "T": self.T.tolist(),
        }

    @classmethod
    def from_json(cls, content: object) -> Deviations:
        """What `as_json` gave.

        Raises:
            InputError: it is something else.
        """
        part = _fields("deviations", content, ("left", "right", "om", "T"))
        cameras = {}
        for name in ("left", "right"):
            camera = _fields(f"deviations.{name}", part[name], ("fx", "fy", "cx", "cy", "distortion"))
            cameras[name] = CameraDeviations(**camera)
        return cls(**cameras, om=part["om"], T=part["T"])


def count_shape(value: Any) -> tuple[int, ...]:
    """The shape of an array or of nested lists; (0,) where the rows of those are of unequal length."""
    try:
        return tuple(np.shape(value))
    except ValueError:
        return (0,)


def _camera_json(camera: CameraDeviations) -> dict[str, Any]:
    plain = {name: getattr(camera, name) for name in ("fx", "fy", "cx", "cy")}
    return {**plain, "distortion": camera.distortion.tolist()}


def _fields(name: str, content: object, wanted: tuple[str, ...]) -> dict[str, Any]:
    if not isinstance(content, dict):
        raise InputError(f"{name} is {content!r:.60}: it must be an object; calibrate again or leave it out")
    missing = [field for field in wanted if field not in content]
    if missing:
        raise InputError(f"{name}.{missing[0]} is missing; calibrate again, or leave the deviations out")
    return {field: content[field] for field in wanted}


def _deviations(name: str, value: object, shape: tuple[int, ...]) -> Doubles:
    """`value` as a read-only float64 array of `shape`, finite and not below zero."""
    try:
        raw = np.asarray(value)
    except ValueError:  # rows of unequal length
        raw = np.empty(0, object)
    if raw.shape != shape or raw.dtype.kind not in "fiu":
        raise InputError(f"deviation of {name} is {value!r:.60}: give {shape} numbers")
    array = raw.astype(np.float64)
    if not (np.isfinite(array).all() and (array >= 0).all()):
        raise InputError(f"deviation of {name} is {value!r:.60}: it must be finite, and zero or more")
    array.flags.writeable = False
    return array
