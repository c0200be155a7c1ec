"""Turn a raw pair into one whose rows correspond, in one resampling."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stereo_gpu.backends import Backend, DeviceArray, open_backend
from stereo_gpu.errors import InputError
from stereo_gpu.images import check_pair
from stereo_gpu.rig import Camera, Rig
from stereo_gpu.types import Doubles, Picture, RectifiedPair


@dataclass(frozen=True, kw_only=True)
class Rectification:
    """The two rectified cameras of a rig.

    Args:
        rotation_left, rotation_right: (3, 3), raw camera frame to rectified frame.
        focal_px, cx_left, cx_right, cy: of the rectified cameras, px.
        baseline: in the rig's unit.
        size: width and height of the rectified pictures, px.
        unit: the rig's unit of length.
    """

    rotation_left: Doubles
    rotation_right: Doubles
    focal_px: float
    cx_left: float
    cx_right: float
    cy: float
    baseline: float
    size: tuple[int, int]
    unit: str


@dataclass(frozen=True, kw_only=True)
class DevicePair:
    """A rectified pair on a device: pictures, and (H, W) uint8 masks that are 1 where they have content."""

    left: DeviceArray
    right: DeviceArray
    valid_left: DeviceArray
    valid_right: DeviceArray


def plan_rectification(rig: Rig) -> Rectification:
    """Find the two rotations that make the rows correspond, and the camera that both pictures are resampled to.

    Method: Bouguet's, as in cv2.stereoRectify; parallel rays have disparity 0.

    Raises:
        InputError: the cameras stand above each other rather than side by side.
    """
    left, right = rig.left, rig.right
    if abs(rig.T[1]) > abs(rig.T[0]):
        raise InputError(
            f"the rig's cameras stand above each other (T = {np.round(rig.T, 3).tolist()}):"
            " turn the pictures by 90 degrees and calibrate again"
        )
    rotation_left, rotation_right, p_left, p_right = cv2.stereoRectify(
        left.matrix,
        left.distortion,
        right.matrix,
        right.distortion,
        left.size,
        rig.R,
        rig.T.reshape(3, 1),
        flags=cv2.CALIB_ZERO_DISPARITY,
        alpha=-1,
    )[:4]
    return Rectification(
        rotation_left=rotation_left,
        rotation_right=rotation_right,
        focal_px=float(p_left[0, 0]),
        cx_left=float(p_left[0, 2]),
        cx_right=float(p_right[0, 2]),
        cy=float(p_left[1, 2]),
        # P_right[0, 3] is -focal baseline for cameras in left, right order.
        baseline=float(-p_right[0, 3] / p_right[0, 0]),
        size=left.size,
        unit=rig.unit,
    )


def rectify(left: Picture, right: Picture, rig: Rig, *, backend: str | None = None) -> RectifiedPair:
    """Undistort and rectify a raw pair.

    Args:
        left, right: raw pictures of the rig's cameras, (H, W) or (H, W, 3), uint8 or uint16.
        rig: the calibrated pair of cameras.
        backend: where to compute; None takes STEREO_GPU_BACKEND, else the best device.

    Returns:
        The pair, its masks of content and its geometry.

    Raises:
        InputError: the pictures do not fit each other or the rig.
        BackendError: the device is missing or fails.
    """
    check_pair(left, right)
    check_sizes(left, rig)
    device = open_backend(backend)
    plan = plan_rectification(rig)
    return download_pair(device, rectify_on(device, left, right, rig, plan), plan)


def check_sizes(left: Picture, rig: Rig) -> None:
    """Refuse pictures that the rig's cameras cannot have taken.

    Raises:
        InputError: with both sizes.
    """
    for camera in (rig.left, rig.right):
        check_size(left.shape[1::-1], camera.size)


def check_size(size: tuple[int, ...], calibrated: tuple[int, ...]) -> None:
    """Refuse pictures of a size, (width, height), that a camera was not calibrated for.

    Raises:
        InputError: with both sizes.
    """
    if tuple(size) != tuple(calibrated):
        raise InputError(
            f"the pictures are {size[0]} x {size[1]}, the rig was calibrated for {calibrated[0]} x {calibrated[1]}:"
            " use pictures of that size, or calibrate with pictures of this one"
        )


def rectify_on(backend: Backend, left: Picture, right: Picture, rig: Rig, plan: Rectification) -> DevicePair:
    """Upload a raw pair and rectify it; the result stays on the device."""
    pixels = plan.size[0] * plan.size[1]
    needed = 2 * (left.nbytes + right.nbytes) + 2 * pixels
    backend.check_memory(needed, max(left.nbytes, right.nbytes), "use smaller pictures")
    new_left, valid_left = _resample(backend, left, rig.left, plan.rotation_left, plan.cx_left, plan)
    new_right, valid_right = _resample(backend, right, rig.right, plan.rotation_right, plan.cx_right, plan)
    return DevicePair(left=new_left, right=new_right, valid_left=valid_left, valid_right=valid_right)


def download_pair(backend: Backend, pair: DevicePair, plan: Rectification) -> RectifiedPair:
    """Copy a rectified pair back, with its geometry."""
    return RectifiedPair(
        left=backend.download(pair.left),
        right=backend.download(pair.right),
        valid_left=backend.download(pair.valid_left),
        valid_right=backend.download(pair.valid_right),
        rotation_left=plan.rotation_left,
        rotation_right=plan.rotation_right,
        focal_px=plan.focal_px,
        baseline=plan.baseline,
        cx_left=plan.cx_left,
        cx_right=plan.cx_right,
        cy=plan.cy,
        unit=plan.unit,
    )


def _resample(
    backend: Backend, picture: Picture, camera: Camera, rotation: Doubles, cx: float, plan: Rectification
) -> tuple[DeviceArray, DeviceArray]:
    width, height = plan.size
    rectified = np.array([[plan.focal_px, 0, cx], [0, plan.focal_px, plan.cy], [0, 0, 1]])
    ray = rotation.T @ np.linalg.inv(rectified)
    matrix, coefficients = camera.matrix, np.zeros(12)
    coefficients[: len(camera.distortion)] = camera.distortion
    lens = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *coefficients], np.float32)
    resampled = backend.empty((height, width, *picture.shape[2:]), picture.dtype)
    valid = backend.empty((height, width), np.uint8)
    backend.launch(
        "rectify",
        picture=backend.upload(picture),
        lens=backend.upload(lens),
        ray=backend.upload(ray.astype(np.float32)),
        source_width=picture.shape[1],
        source_height=picture.shape[0],
        channels=1 if picture.ndim == 2 else 3,
        width=width,
        height=height,
        rectified_out=resampled,
        valid_out=valid,
    )
    return resampled, valid
