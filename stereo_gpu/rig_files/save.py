"""Write a rig as a calibration file of another program, or as our own."""

from __future__ import annotations

import os
from pathlib import Path

from stereo_gpu.errors import InputError
from stereo_gpu.files import check_writable_file, whole_folder, write_whole
from stereo_gpu.rig import Rig
from stereo_gpu.rig_files.matlab_write import write_matlab
from stereo_gpu.rig_files.opencv_write import write_opencv_xml, write_opencv_yaml
from stereo_gpu.rig_files.ros_write import write_ros

# Name of a format: suffixes that stand for it. ROS's is a folder.
FORMATS = {"json": (".json",), "yaml": (".yml", ".yaml"), "xml": (".xml",), "mat": (".mat",), "ros": ()}


def save_rig(rig: Rig, path: str | os.PathLike[str], *, format: str | None = None) -> tuple[Path, ...]:
    """Write a rig, whole or not at all.

    Cameras, R, T and the unit keep every digit. The errors and deviations of the calibration stay as far as the
    format has a place for them; only json keeps all.

    Args:
        rig: what to write.
        path: the file; for ros the folder, which is made if missing and gets left.yaml and right.yaml.
        format: json (ours), yaml or xml (OpenCV), mat (Camera Calibration Toolbox for Matlab) or ros (camera_info);
            None takes it from the suffix.

    Returns:
        The files.

    Raises:
        InputError: the format is unknown or cannot hold this rig, or the file cannot be written.
    """
    path = Path(path)
    kind = check_format(path, format)
    if not (rig.unit.isascii() and rig.unit.isalpha()) and kind != "json":
        raise InputError(f"unit is {rig.unit!r}: only json holds other signs than letters; write json")
    if kind == "ros":
        texts = write_ros(rig)
        names = ("left.yaml", "right.yaml")
        with whole_folder(path) as new:
            for name, text in zip(names, texts, strict=True):
                write_whole(new / name, text)
        return tuple(path / name for name in names)
    if kind == "json":
        return (rig.save(path),)
    if kind == "mat":
        return (write_whole(path, write_matlab(rig)),)
    return (write_whole(path, write_opencv_yaml(rig) if kind == "yaml" else write_opencv_xml(rig)),)


def check_format(path: str | os.PathLike[str], format: str | None) -> str:
    """The format that is meant, before any work is done.

    Raises:
        InputError: it is unknown, or the place cannot be written.
    """
    path = Path(path)
    if format is not None and format not in FORMATS:
        raise InputError(f"format {format!r:.40} is unknown: give one of {', '.join(FORMATS)}")
    if format is None:
        kinds = [name for name, suffixes in FORMATS.items() if path.suffix.lower() in suffixes]
        if not kinds:
            known = ", ".join(suffix for suffixes in FORMATS.values() for suffix in suffixes)
            raise InputError(f"{path} ends in none of {known}: name the format, such as json, or ros for a folder")
        format = kinds[0]
    if format == "ros":
        if path.suffix.lower() in (".yaml", ".yml") and not path.is_dir():
            raise InputError(f"{path} is one file, and ROS takes two: name a folder")
    else:
        check_writable_file(path)
    return format
