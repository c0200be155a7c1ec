"""The OpenCV functions that the benchmark times beside ours: what they are called with, and what they take."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from stereo_gpu.bench.scene import BenchScene
from stereo_gpu.config import PROFILES, Profile
from stereo_gpu.rectify import plan_rectification

Run = Callable[[], object]
SGBM_BLOCK = 5
SMOOTH_SIGMA = 1.0
MEDIAN = PROFILES[Profile.FAST].median


@dataclass(frozen=True)
class Peer:
    """An OpenCV function.

    Args:
        name: short, for columns.
        settings: what it is called with; {D} and {w} stand for disparities and window.
        make: prepares its input and returns what is timed.
        volume_bytes: that it holds for each pixel and disparity.
    """

    name: str
    settings: str
    make: Callable[[BenchScene], Run]
    volume_bytes: int = 0


def _block_matcher(scene: BenchScene) -> Run:
    matcher = cv2.StereoBM.create(scene.disparities, scene.window)
    return lambda: matcher.compute(scene.left, scene.right)


def _checked_block_matcher(scene: BenchScene) -> Run:
    matcher = cv2.StereoBM.create(scene.disparities, scene.window)
    matcher.setDisp12MaxDiff(1)
    return lambda: cv2.medianBlur(matcher.compute(scene.left, scene.right), MEDIAN)


def _semi_global(scene: BenchScene, mode: int) -> Run:
    matcher = cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=scene.disparities,
        blockSize=SGBM_BLOCK,
        P1=8 * SGBM_BLOCK**2,
        P2=32 * SGBM_BLOCK**2,
        mode=mode,
    )
    return lambda: matcher.compute(scene.left, scene.right)


def _colour_to_grey(scene: BenchScene) -> Run:
    colour = scene.colour[1]
    return lambda: cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY)


def _gaussian(scene: BenchScene) -> Run:
    grey, side = scene.right.astype(np.float32), 2 * int(np.ceil(3 * SMOOTH_SIGMA)) + 1
    return lambda: cv2.GaussianBlur(grey, (side, side), SMOOTH_SIGMA, borderType=cv2.BORDER_REPLICATE)


def _box_sums(scene: BenchScene) -> Run:
    grey, size = scene.right.astype(np.float32), (scene.window, scene.window)

    def run() -> object:
        total = cv2.boxFilter(grey, cv2.CV_32F, size, normalize=False, borderType=cv2.BORDER_REPLICATE)
        squares = cv2.sqrBoxFilter(grey, cv2.CV_32F, size, normalize=False, borderType=cv2.BORDER_REPLICATE)
        return total, squares

    return run


def _remap(scene: BenchScene, colour: bool) -> Run:
    plan, camera = plan_rectification(scene.rig), scene.rig.left
    matrix = np.array([[plan.focal_px, 0, plan.cx_left], [0, plan.focal_px, plan.cy], [0, 0, 1]])
    maps = cv2.initUndistortRectifyMap(
        camera.matrix, camera.distortion, plan.rotation_left, matrix, plan.size, cv2.CV_32FC1
    )
    picture = scene.colour[0] if colour else scene.left
    return lambda: cv2.remap(picture, maps[0], maps[1], cv2.INTER_LINEAR)


def _median(scene: BenchScene) -> Run:
    values = scene.disparity.copy()
    return lambda: cv2.medianBlur(values, MEDIAN)


def _validate(scene: BenchScene) -> Run:
    values = np.round(scene.disparity * 16).astype(np.int16)
    cost = np.full(values.shape, 100, np.int16)
    return lambda: cv2.validateDisparity(values, cost, 0, scene.disparities, 1)


def _reproject(scene: BenchScene) -> Run:
    pair, values = scene.pair, scene.disparity
    q = np.array(
        [
            [1, 0, 0, -pair.cx_left],
            [0, 1, 0, -pair.cy],
            [0, 0, 0, pair.focal_px],
            [0, 0, 1 / pair.baseline, 0],
        ]
    )
    return lambda: cv2.reprojectImageTo3D(values, q)


_SGBM = f"minDisparity=0, numDisparities={{D}}, blockSize={SGBM_BLOCK}, P1=8*{SGBM_BLOCK}*{SGBM_BLOCK},"
_SGBM += f" P2=32*{SGBM_BLOCK}*{SGBM_BLOCK}"

STEREO_BM = Peer("StereoBM", "numDisparities={D}, blockSize={w}, compute", _block_matcher)
CHECKED_BM = Peer(
    "StereoBM+check+median",
    f"the same with disp12MaxDiff=1, then medianBlur(int16, {MEDIAN})",
    _checked_block_matcher,
)
SGBM_3WAY = Peer(
    "SGBM 3WAY",
    f"StereoSGBM, {_SGBM}, MODE_SGBM_3WAY",
    functools.partial(_semi_global, mode=cv2.StereoSGBM_MODE_SGBM_3WAY),
)
SGBM_HH = Peer(
    "SGBM HH",
    f"StereoSGBM, {_SGBM}, MODE_HH (8 paths, one thread)",
    functools.partial(_semi_global, mode=cv2.StereoSGBM_MODE_HH),
    volume_bytes=4,  # costs and sums, 16 bits each
)
MATCHERS = (STEREO_BM, CHECKED_BM, SGBM_3WAY, SGBM_HH)

CVT_COLOR = Peer("cvtColor", "COLOR_RGB2GRAY on 8 bits; does not scale or centre", _colour_to_grey)
GAUSSIAN_BLUR = Peer("GaussianBlur", f"float32, sigma {SMOOTH_SIGMA:g}, BORDER_REPLICATE", _gaussian)
BOX_FILTERS = Peer(
    "boxFilter+sqrBoxFilter", "float32, {w} x {w}; gives the two sums, not yet the inverse norm", _box_sums
)
REMAP = Peer(
    "remap",
    "8-bit grey, INTER_LINEAR, ready float32 maps; makes no mask",
    functools.partial(_remap, colour=False),
)
REMAP_COLOUR = Peer("remap RGB", "the same on 8-bit RGB", functools.partial(_remap, colour=True))
MEDIAN_BLUR = Peer("medianBlur", f"float32, {MEDIAN} x {MEDIAN}; knows no missing pixels", _median)
VALIDATE = Peer(
    "validateDisparity", "disp12MaxDisp=1; also makes the other view's winners, from costs, one thread", _validate
)
REPROJECT = Peer("reprojectImageTo3D", "float32 disparity, 4 x 4 matrix Q", _reproject)
STAGES = (CVT_COLOR, GAUSSIAN_BLUR, BOX_FILTERS, REMAP, REMAP_COLOUR, MEDIAN_BLUR, VALIDATE, REPROJECT)
