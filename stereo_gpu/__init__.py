"""Two cameras in, a textured metric 3-D model out, on any GPU or none.

    import stereo_gpu as sg
    rig = sg.calibrate(left_paths, right_paths, sg.Board(10, 7, 30.0))
    sg.reconstruct("left.png", "right.png", rig).save("out")

Conventions stand in `stereo_gpu.types`, errors in `stereo_gpu.errors`.
"""

from stereo_gpu.backends import DeviceStatus, devices
from stereo_gpu.boards.board import Board
from stereo_gpu.boards.board_print import PrintedBoard, print_board
from stereo_gpu.boards.charuco import CharucoBoard
from stereo_gpu.calibrate import calibrate, calibrate_in_full
from stereo_gpu.calibration.outcome import Calibration
from stereo_gpu.capture import Recording, capture
from stereo_gpu.check import PairCheck, check_rectified
from stereo_gpu.config import MeshOptions
from stereo_gpu.deviations import Deviations
from stereo_gpu.epipolar.eight_point import eight_point
from stereo_gpu.epipolar.features import match_features
from stereo_gpu.epipolar.pose import estimate_pose
from stereo_gpu.errors import StereoError
from stereo_gpu.images import read_image
from stereo_gpu.known_distance import KnownDistance
from stereo_gpu.match import match
from stereo_gpu.pipeline import reconstruct, reconstruct_rectified
from stereo_gpu.recording.settings import CameraSettings
from stereo_gpu.rectify import rectify
from stereo_gpu.refine_rig import Refinement, refine_rig
from stereo_gpu.result import Reconstruction
from stereo_gpu.rig import Camera, Rig
from stereo_gpu.rig_check import RigCheck, check_rig
from stereo_gpu.rig_files.load import load_rig
from stereo_gpu.rig_files.save import save_rig
from stereo_gpu.triangulate import triangulate
from stereo_gpu.types import Disparity, Mesh, RectifiedPair, Surface, Validity, View

__all__ = [
    "Board",
    "Calibration",
    "Camera",
    "CameraSettings",
    "CharucoBoard",
    "Deviations",
    "DeviceStatus",
    "Disparity",
    "KnownDistance",
    "Mesh",
    "MeshOptions",
    "PairCheck",
    "PrintedBoard",
    "Reconstruction",
    "Recording",
    "RectifiedPair",
    "Refinement",
    "Rig",
    "RigCheck",
    "StereoError",
    "Surface",
    "Validity",
    "View",
    "calibrate",
    "calibrate_in_full",
    "capture",
    "check_rectified",
    "check_rig",
    "devices",
    "eight_point",
    "estimate_pose",
    "load_rig",
    "match",
    "match_features",
    "print_board",
    "read_image",
    "reconstruct",
    "reconstruct_rectified",
    "rectify",
    "refine_rig",
    "save_rig",
    "triangulate",
]
