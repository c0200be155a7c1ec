"""Two cameras in, a textured metric 3-D model out, on any GPU or none.

    import stereo_gpu as sg
    rig = sg.calibrate(left_paths, right_paths, sg.Board(10, 7, 30.0))
    sg.reconstruct("left.png", "right.png", rig).save("out")

Conventions stand in `stereo_gpu.types`, errors in `stereo_gpu.errors`.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # what `_MODULES` says, for type checkers and editors; a test compares the two
    from stereo_gpu.backends import DeviceStatus as DeviceStatus
    from stereo_gpu.backends import devices as devices
    from stereo_gpu.boards.board import Board as Board
    from stereo_gpu.boards.board_print import PrintedBoard as PrintedBoard
    from stereo_gpu.boards.board_print import print_board as print_board
    from stereo_gpu.boards.charuco import CharucoBoard as CharucoBoard
    from stereo_gpu.calibrate import calibrate as calibrate
    from stereo_gpu.calibrate import calibrate_in_full as calibrate_in_full
    from stereo_gpu.calibration.outcome import Calibration as Calibration
    from stereo_gpu.capture import Recording as Recording
    from stereo_gpu.capture import capture as capture
    from stereo_gpu.check import PairCheck as PairCheck
    from stereo_gpu.check import check_rectified as check_rectified
    from stereo_gpu.close_holes import close_holes as close_holes
    from stereo_gpu.config import MeshOptions as MeshOptions
    from stereo_gpu.deviations import Deviations as Deviations
    from stereo_gpu.epipolar.eight_point import eight_point as eight_point
    from stereo_gpu.epipolar.features import match_features as match_features
    from stereo_gpu.epipolar.pose import estimate_pose as estimate_pose
    from stereo_gpu.errors import StereoError as StereoError
    from stereo_gpu.images import read_image as read_image
    from stereo_gpu.known_distance import KnownDistance as KnownDistance
    from stereo_gpu.match import match as match
    from stereo_gpu.pipeline import reconstruct as reconstruct
    from stereo_gpu.pipeline import reconstruct_rectified as reconstruct_rectified
    from stereo_gpu.read_model import read_glb as read_glb
    from stereo_gpu.reconstruct_many import Outcome as Outcome
    from stereo_gpu.reconstruct_many import reconstruct_many as reconstruct_many
    from stereo_gpu.recording.settings import CameraSettings as CameraSettings
    from stereo_gpu.rectify import rectify as rectify
    from stereo_gpu.refine_rig import Refinement as Refinement
    from stereo_gpu.refine_rig import refine_rig as refine_rig
    from stereo_gpu.render import render as render
    from stereo_gpu.result import Reconstruction as Reconstruction
    from stereo_gpu.rig import Camera as Camera
    from stereo_gpu.rig import Rig as Rig
    from stereo_gpu.rig_check import RigCheck as RigCheck
    from stereo_gpu.rig_check import check_rig as check_rig
    from stereo_gpu.rig_files.load import load_rig as load_rig
    from stereo_gpu.rig_files.save import save_rig as save_rig
    from stereo_gpu.triangulate import triangulate as triangulate
    from stereo_gpu.turntable import turntable as turntable
    from stereo_gpu.types import Disparity as Disparity
    from stereo_gpu.types import Mesh as Mesh
    from stereo_gpu.types import RectifiedPair as RectifiedPair
    from stereo_gpu.types import Surface as Surface
    from stereo_gpu.types import Validity as Validity
    from stereo_gpu.types import View as View

# The module that each public name is imported from when somebody first asks for it: all of them together take a
# third of a second, which `stereo-gpu --help` and every worker process would pay.
_MODULES = {
    "Board": "stereo_gpu.boards.board",
    "Calibration": "stereo_gpu.calibration.outcome",
    "Camera": "stereo_gpu.rig",
    "CameraSettings": "stereo_gpu.recording.settings",
    "CharucoBoard": "stereo_gpu.boards.charuco",
    "Deviations": "stereo_gpu.deviations",
    "DeviceStatus": "stereo_gpu.backends",
    "Disparity": "stereo_gpu.types",
    "KnownDistance": "stereo_gpu.known_distance",
    "Mesh": "stereo_gpu.types",
    "MeshOptions": "stereo_gpu.config",
    "Outcome": "stereo_gpu.reconstruct_many",
    "PairCheck": "stereo_gpu.check",
    "PrintedBoard": "stereo_gpu.boards.board_print",
    "Reconstruction": "stereo_gpu.result",
    "Recording": "stereo_gpu.capture",
    "RectifiedPair": "stereo_gpu.types",
    "Refinement": "stereo_gpu.refine_rig",
    "Rig": "stereo_gpu.rig",
    "RigCheck": "stereo_gpu.rig_check",
    "StereoError": "stereo_gpu.errors",
    "Surface": "stereo_gpu.types",
    "Validity": "stereo_gpu.types",
    "View": "stereo_gpu.types",
    "calibrate": "stereo_gpu.calibrate",
    "calibrate_in_full": "stereo_gpu.calibrate",
    "capture": "stereo_gpu.capture",
    "check_rectified": "stereo_gpu.check",
    "check_rig": "stereo_gpu.rig_check",
    "close_holes": "stereo_gpu.close_holes",
    "devices": "stereo_gpu.backends",
    "eight_point": "stereo_gpu.epipolar.eight_point",
    "estimate_pose": "stereo_gpu.epipolar.pose",
    "load_rig": "stereo_gpu.rig_files.load",
    "match": "stereo_gpu.match",
    "match_features": "stereo_gpu.epipolar.features",
    "print_board": "stereo_gpu.boards.board_print",
    "read_glb": "stereo_gpu.read_model",
    "read_image": "stereo_gpu.images",
    "reconstruct": "stereo_gpu.pipeline",
    "reconstruct_many": "stereo_gpu.reconstruct_many",
    "reconstruct_rectified": "stereo_gpu.pipeline",
    "rectify": "stereo_gpu.rectify",
    "refine_rig": "stereo_gpu.refine_rig",
    "render": "stereo_gpu.render",
    "save_rig": "stereo_gpu.rig_files.save",
    "triangulate": "stereo_gpu.triangulate",
    "turntable": "stereo_gpu.turntable",
}
__all__ = list(_MODULES)


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULES})


class _Package(ModuleType):
    """The package, in which `match` stays the function when its module of the same name is imported."""

    def __setattr__(self, name: str, value: object) -> None:
        # Python hangs each submodule on its package by its name.
        if not (name in _MODULES and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
