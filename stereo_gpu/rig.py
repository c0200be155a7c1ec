"""The calibrated pair of cameras, and the JSON file that keeps it."""

from __future__ import annotations

import json
import math
import os
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from stereo_gpu.deviations import Deviations, count_shape
from stereo_gpu.errors import InputError
from stereo_gpu.files import write_whole
from stereo_gpu.types import Doubles

FORMAT = "stereo-gpu rig"
VERSION = 1
LARGEST_FILE = 16 * 2**20  # bytes; ten thousand views take about 3 MB
LARGEST_SIDE = 100_000  # px
ROTATION_TOLERANCE = 1e-6  # largest |R R' - 1|: a rotation typed in with seven digits still passes
DISTORTION_COUNTS = (5, 8, 12)
MEND = "calibrate again or mend the value"


@dataclass(frozen=True, eq=False)
class Camera:
    """One camera: pinhole with OpenCV's lens model.

    Args:
        matrix: (3, 3) float64, px: focal lengths and principal point.
        distortion: (n,) float64, n = 5, 8 or 12: k1 k2 p1 p2 k3 [k4 k5 k6 [s1 s2 s3 s4]].
        size: width and height, px.
        rms_px: reprojection error of its calibration.

    Raises:
        InputError: a value is of the wrong shape or no camera can have it.
    """

    matrix: Doubles
    distortion: Doubles
    size: tuple[int, int]
    rms_px: float = 0.0

    def __post_init__(self) -> None:
        matrix = _array("matrix", self.matrix, (3, 3))
        shape = count_shape(self.distortion)
        if len(shape) != 1 or shape[0] not in DISTORTION_COUNTS:
            raise InputError(f"distortion has shape {shape}: give 5, 8 or 12 numbers in OpenCV's order")
        distortion = _array("distortion", self.distortion, shape)
        for name, value in (("fx", matrix[0, 0]), ("fy", matrix[1, 1])):
            if value <= 0:
                raise InputError(f"matrix has focal length {name} = {value:g}: it must be above zero; {MEND}")
        if matrix[1, 0] != 0 or matrix[2].tolist() != [0, 0, 1]:
            raise InputError(f"matrix must read fx s cx / 0 fy cy / 0 0 1, but has {matrix[1:].tolist()}; {MEND}")
        if matrix[0, 1] != 0:
            raise InputError(f"matrix has skew {matrix[0, 1]:g}: only cameras without skew are supported")
        object.__setattr__(self, "matrix", matrix)
        object.__setattr__(self, "distortion", distortion)
        object.__setattr__(self, "size", _size(self.size))
        object.__setattr__(self, "rms_px", _error_px("rms_px", self.rms_px))


@dataclass(frozen=True)
class ViewError:
    """What one board pair contributed.

    Args:
        left, right: names of the two pictures.
        left_px, right_px: rms reprojection error with the final rig; None where the pair is not used.
        epipolar_px: rms distance of its corners from their epipolar lines.
        used: whether the pair counts in the calibration.
        reason: why it was left out; empty where it is used.
    """

    left: str
    right: str
    left_px: float | None = None
    right_px: float | None = None
    epipolar_px: float | None = None
    used: bool = True
    reason: str = ""

    def __post_init__(self) -> None:
        for name in ("left", "right", "reason"):
            if not isinstance(getattr(self, name), str):
                raise InputError(f"{name} is {getattr(self, name)!r:.60}: it must be text")
        if not isinstance(self.used, bool):
            raise InputError(f"used is {self.used!r:.60}: it must be true or false")
        for name in ("left_px", "right_px", "epipolar_px"):
            value = getattr(self, name)
            object.__setattr__(self, name, None if value is None else _error_px(name, value))


@dataclass(frozen=True, eq=False)
class Rig:
    """Two cameras and how they stand to each other: X_right = R X_left + T.

    Args:
        left, right: the cameras.
        R: (3, 3) float64 rotation.
        T: (3,) float64, in `unit`; T[0] < 0 where the left camera stands on the left.
        rms_px: reprojection error of the stereo calibration, over both pictures.
        epipolar_rms_px: rms distance of the board corners from their epipolar lines.
        views: what each board pair contributed.
        unit: of T, and so of everything measured with this rig.
        deviations: how certain every parameter is; None where that is not known.

    Raises:
        InputError: a value is of the wrong shape or no rig can have it.
    """

    left: Camera
    right: Camera
    R: Doubles
    T: Doubles
    rms_px: float = 0.0
    epipolar_rms_px: float = 0.0
    views: tuple[ViewError, ...] = ()
    unit: str = "mm"
    deviations: Deviations | None = None

    def __post_init__(self) -> None:
        rotation = _array("R", self.R, (3, 3))
        translation = _array("T", self.T, (3,))
        # Huge numbers give infinity or NaN here, which is no rotation either.
        with np.errstate(over="ignore", invalid="ignore"):
            off = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
        if not off <= ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
            detail = "mirrors" if off <= ROTATION_TOLERANCE else f"is off by {off:.2g}"
            raise InputError(f"R is no rotation: it {detail}; {MEND}")
        if not math.hypot(*translation) > 0:
            raise InputError(f"T is {translation.tolist()}: the cameras stand at one point; {MEND}")
        check_unit(self.unit)
        if self.deviations is not None:
            _check_deviations(self.deviations, self.left, self.right)
        object.__setattr__(self, "R", rotation)
        object.__setattr__(self, "T", translation)
        object.__setattr__(self, "rms_px", _error_px("rms_px", self.rms_px))
        object.__setattr__(self, "epipolar_rms_px", _error_px("epipolar_rms_px", self.epipolar_rms_px))
        object.__setattr__(self, "views", tuple(self.views))

    @property
    def baseline(self) -> float:
        """Distance between the cameras, in `unit`."""
        return math.hypot(*self.T.tolist())  # which does not overflow

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the rig as JSON, with every digit, whole or not at all.

        Raises:
            InputError: the file cannot be written.
        """
        content = {
            "format": FORMAT,
            "version": VERSION,
            "convention": "X_right = R X_left + T; distortion in OpenCV's order",
            "unit": self.unit,
            "left": _camera_json(self.left),
            "right": _camera_json(self.right),
            "R": self.R.tolist(),
            "T": self.T.tolist(),
            "rms_px": self.rms_px,
            "epipolar_rms_px": self.epipolar_rms_px,
            **({} if self.deviations is None else {"deviations": self.deviations.as_json()}),
            "views": [{field.name: getattr(view, field.name) for field in fields(view)} for view in self.views],
        }
        return write_whole(path, json.dumps(content, indent=1, allow_nan=False) + "\n")

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Rig:
        """Read a rig that `save` wrote.

        Raises:
            InputError: the file is missing, is not such a file, or says what no rig can be.
        """
        content = _read_json(Path(path))
        try:
            return _rig(content)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error


def check_unit(unit: object) -> None:
    """Refuse what names no unit of length.

    Raises:
        InputError: it is no text of 1 to 16 signs that can be shown.
    """
    if not (isinstance(unit, str) and 0 < len(unit) <= 16 and unit.isprintable()):
        raise InputError(f"unit is {unit!r:.60}: name a unit of length such as mm")


def _rig(content: dict[str, Any]) -> Rig:
    if content.get("format") != FORMAT:
        raise InputError(f"format is {content.get('format')!r:.60}, not {FORMAT!r}: is this the file of a rig?")
    if content.get("version") != VERSION:
        raise InputError(f"version is {content.get('version')!r:.60}, this program reads {VERSION}: update it")
    views = _field(content, "views")
    if not isinstance(views, list):
        raise InputError(f"views is {views!r:.60}: it must be a list")
    # Files from before there were deviations have none.
    deviations = content.get("deviations")
    return Rig(
        left=_camera(content, "left"),
        right=_camera(content, "right"),
        R=_field(content, "R"),
        T=_field(content, "T"),
        rms_px=_field(content, "rms_px"),
        epipolar_rms_px=_field(content, "epipolar_rms_px"),
        views=tuple(_view(number, view) for number, view in enumerate(views)),
        unit=_field(content, "unit"),
        deviations=None if deviations is None else Deviations.from_json(deviations),
    )


def _check_deviations(deviations: object, left: Camera, right: Camera) -> None:
    """Make sure that there is a deviation for every coefficient of the lenses."""
    if not isinstance(deviations, Deviations):
        raise InputError(f"deviations is {deviations!r:.60}: give Deviations, or None")
    for name, camera, part in (("left", left, deviations.left), ("right", right, deviations.right)):
        if part.distortion.shape != camera.distortion.shape:
            raise InputError(
                f"deviations.{name}.distortion has {len(part.distortion)} numbers, the lens has"
                f" {len(camera.distortion)}; {MEND}"
            )


def _camera(content: dict[str, Any], name: str) -> Camera:
    part = _field(content, name)
    if not isinstance(part, dict):
        raise InputError(f"{name} is {part!r:.60}: it must be a camera")
    try:
        return Camera(**{key: _field(part, key) for key in ("matrix", "distortion", "size", "rms_px")})
    except InputError as error:
        raise InputError(f"{name}.{error}") from error


def _view(number: int, part: object) -> ViewError:
    if not isinstance(part, dict):
        raise InputError(f"views[{number}] is {part!r:.60}: it must be an object")
    try:
        return ViewError(**{field.name: _field(part, field.name) for field in fields(ViewError)})
    except InputError as error:
        raise InputError(f"views[{number}].{error}") from error


def _camera_json(camera: Camera) -> dict[str, Any]:
    return {
        "matrix": camera.matrix.tolist(),
        "distortion": camera.distortion.tolist(),
        "size": list(camera.size),
        "rms_px": camera.rms_px,
    }


def _field(part: dict[str, Any], name: str) -> Any:
    if name not in part:
        raise InputError(f"{name} is missing; calibrate again or add it")
    return part[name]


def _array(name: str, value: object, shape: tuple[int, ...]) -> Doubles:
    """`value` as a read-only float64 array of `shape`, all finite."""
    try:
        raw = np.asarray(value)
    except ValueError:  # rows of unequal length
        raise InputError(f"{name} is {value!r:.60}: it must be {shape} numbers; {MEND}") from None
    if raw.shape != shape or raw.dtype.kind not in "fiu":
        seen = f"shape {raw.shape}" if raw.shape != shape else f"{value!r:.60}"
        raise InputError(f"{name} has {seen}: it must be {shape} numbers; {MEND}")
    array = raw.astype(np.float64)
    if not np.isfinite(array).all():
        raise InputError(f"{name} has a value of {array[~np.isfinite(array)][0]}: it must be finite; {MEND}")
    array.flags.writeable = False
    return array


def _error_px(name: str, value: object) -> float:
    number = float(_array(name, value, ()))
    if isinstance(value, bool) or number < 0:
        raise InputError(f"{name} is {value!r:.60}: an error in px must be zero or more; {MEND}")
    return number


def _size(value: object) -> tuple[int, int]:
    width, height = _array("size", value, (2,))
    for side in (width, height):
        if not (side == int(side) and 1 <= side <= LARGEST_SIDE):
            raise InputError(f"size is {value!r:.60}: width and height must be 1 to {LARGEST_SIDE} px; {MEND}")
    return int(width), int(height)


def _read_json(path: Path) -> dict[str, Any]:
    if path.is_dir():
        raise InputError(f"{path} is a folder: name the rig's file in it")
    try:
        with path.open("rb") as stream:
            data = stream.read(LARGEST_FILE + 1)
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file; calibrate first, or check the path") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}; check the path") from error
    if len(data) > LARGEST_FILE:
        raise InputError(f"{path} is larger than {LARGEST_FILE >> 20} MiB: is this the file of a rig?")
    try:
        content = json.loads(data)
    except json.JSONDecodeError as error:
        raise InputError(
            f"{path} is not JSON, or is cut off: {error.msg} at line {error.lineno}; calibrate again"
        ) from None
    except (UnicodeDecodeError, RecursionError, ValueError) as error:
        raise InputError(f"{path} is not JSON ({type(error).__name__}): is this the file of a rig?") from None
    if not isinstance(content, dict):
        raise InputError(f"{path} holds a {type(content).__name__}, not an object: is this the file of a rig?")
    return content
