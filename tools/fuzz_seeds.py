"""What the fuzzer starts from: calibration files that every reader takes, and the code that reads each."""

import io
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from scipy.io import savemat

import stereo_gpu as sg

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))
from calibration_files import KITTI_ODOMETRY, KITTI_RAW, MIDDLEBURY, make_rig  # noqa: E402

SHARED = tuple(f"rig_files/{name}" for name in ("load", "source", "judge", "geometry", "tree", "yaml_tree"))


@dataclass(frozen=True)
class Reader:
    """One reader of files.

    Args:
        modules: files of stereo_gpu whose functions read, without the suffix.
        seeds: sets of files that it takes: name and content of each.
        passed_over: functions of the modules that do not read.
    """

    modules: tuple[str, ...]
    seeds: list[dict[str, bytes]]
    passed_over: tuple[str, ...] = ()


def readers() -> dict[str, Reader]:
    """Every reader of calibration files, by name."""

    def parts(*names: str) -> tuple[str, ...]:
        return tuple(f"rig_files/{name}" for name in names)

    return {
        "json": Reader(("rig", "deviations"), _own(), ("save", "_camera_json", "baseline", "as_json")),
        "opencv yaml": Reader(parts("opencv", "yaml_tree"), _opencv("yml")),
        "opencv xml": Reader(parts("opencv", "xml_tree"), _opencv("xml")),
        "opencv json": Reader(parts("opencv", "json_tree"), _opencv("json")),
        "ros": Reader(parts("ros", "yaml_tree"), _ros()),
        "matlab": Reader(parts("matlab", "mat_variables"), _matlab()),
        "middlebury": Reader(parts("middlebury", "text_lines"), [{"calib.txt": MIDDLEBURY.encode()}]),
        "kitti": Reader(
            parts("kitti", "text_lines"),
            [{"calib.txt": KITTI_ODOMETRY.encode()}, {"calib_cam_to_cam.txt": KITTI_RAW.encode()}],
        ),
    }


def _written(rig: sg.Rig, name: str, kind: str | None = None) -> dict[str, bytes]:
    """What `save_rig` writes."""
    with tempfile.TemporaryDirectory() as folder:
        return {file.name: file.read_bytes() for file in sg.save_rig(rig, Path(folder) / name, format=kind)}


def _own() -> list[dict[str, bytes]]:
    from stereo_gpu.rig import ViewError

    views = (ViewError("l1.png", "r1.png", 0.1, 0.2, 0.3), ViewError("l2.png", "r2.png", used=False, reason="blurred"))
    return [_written(rig, "rig.json") for rig in (replace(make_rig(deviations=True), views=views), make_rig(12))]


def _opencv(suffix: str) -> list[dict[str, bytes]]:
    """Our own, and OpenCV's in one file and in two."""
    rig = make_rig()
    ours = [] if suffix == "json" else [_written(rig, f"rig.{suffix}"), _written(make_rig(12), f"rig.{suffix}")]
    lenses = {"K1": rig.left.matrix, "D1": rig.left.distortion, "K2": rig.right.matrix, "D2": rig.right.distortion[:4]}
    place = {"R": np.round(rig.R, 5), "T": rig.T.reshape(3, 1)}
    sizes = {"imageSize": np.array([640, 480]), "note": "text", "rms": 0.2}
    nested = {"left": {"camera_matrix": rig.left.matrix}, "rms_px1": 0.1}
    first = _storage({**lenses, **place, **sizes}, suffix)
    return [
        *ours,
        {f"rig.{suffix}": first},
        {f"rig.{suffix}": _storage({**lenses, **place}, suffix)},
        {f"rig.{suffix}": _storage({**lenses, **place, **nested}, suffix)},
        {f"intrinsics.{suffix}": _storage(lenses, suffix), f"extrinsics.{suffix}": _storage(place, suffix)},
    ]


def _storage(content: dict[str, object], suffix: str) -> bytes:
    """What cv2.FileStorage writes."""
    storage = cv2.FileStorage(f".{suffix}", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for name, value in content.items():
        if isinstance(value, dict):
            storage.startWriteStruct(name, cv2.FILE_NODE_MAP)
            for inner, part in value.items():
                storage.write(inner, part)
            storage.endWriteStruct()
        else:
            storage.write(name, value)
    return storage.releaseAndGetString().encode()


def _ros() -> list[dict[str, bytes]]:
    """With our own entry, and without, as ROS writes them."""
    found = []
    for rig in (make_rig(), make_rig(8)):
        files = _written(rig, "ros", "ros")
        found += [files, {name: data.partition(b"stereo_gpu:")[0] for name, data in files.items()}]
    return found


def _matlab() -> list[dict[str, bytes]]:
    """As `save_rig` writes it, and not compressed, with other variables and with numbers of every kind."""
    rig = make_rig(deviations=True)
    ours = _written(rig, "rig.mat")
    with tempfile.TemporaryDirectory() as folder:
        from scipy.io import loadmat

        content = loadmat(sg.save_rig(rig, Path(folder) / "rig.mat")[0])
    plain = {name: value for name, value in content.items() if not name.startswith("_")}
    other = {
        **{name: value for name, value in plain.items() if not name.endswith("_error") and name != "R"},
        "nx": np.uint16(640),
        "kc_left": np.zeros((4, 1), np.float32),
        "alpha_c_left": 1e-9,
        "history": np.array(["a", 1.0], dtype=object),
        "param": np.arange(9000.0),
    }
    without_om = {name: value for name, value in plain.items() if name != "om"}
    return [ours, *({"rig.mat": _mat(one, pack)} for one in (plain, other, without_om) for pack in (False, True))]


def _mat(content: dict[str, object], pack: bool) -> bytes:
    stream = io.BytesIO()
    savemat(stream, content, do_compression=pack)
    return stream.getvalue()
